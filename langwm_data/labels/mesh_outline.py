"""Silhouettes of meshes, neither convex nor closed: which pixel rows they cover, from where to where.

A mesh is looked at as two sheets, the triangles that turn towards the camera and those that turn away; a
sheet covers a point of the picture where its outline winds around it. Edges inside a sheet cancel, so only
the outline is projected, which is a small part of the mesh. Closed bodies cover from behind what they cover
from before, so of them one sheet is enough.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.scenes.spec import Quat, Vec3
from langwm_data.sim.asset_mesh import asset_mesh
from langwm_data.sim.camera import Camera

MAX_OUTSIDE_PX = 100_000
"""Silhouettes are cut this far from the picture: near the camera's own plane they would have no end."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshSolid:
    """A mesh in world coordinates, its vertices at one place made one."""

    center: Floats
    """(3,), of the ball around it, metres."""
    radius_m: float
    triangles: Floats
    """(T, 3, 3), corners, metres."""
    planes: Floats
    """(T, 4): a point x lies before a triangle where planes @ (x, 1) > 0."""
    is_open: Bools
    """(T,), whether a triangle belongs to no closed body."""
    edges: Floats
    """(E, 2, 3), where each edge starts and ends, metres."""
    along: Ints
    """(E,), the triangle that goes along each edge; T, one past the last, for none."""
    against: Ints
    """(E,), the triangle that goes against it."""


def mesh_solid(mesh: TriangleMesh, position: Vec3, orientation: Quat) -> MeshSolid:
    """What silhouettes need of a mesh that stands somewhere."""
    form = _form(mesh)
    points = form.points.astype(np.float64) @ quat_matrix(orientation).T + position
    corners = form.corners
    first, second, third = np.moveaxis(points[corners], 1, 0)
    normal = np.cross(second - first, third - first)
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    return MeshSolid(
        center=center,
        radius_m=float(np.linalg.norm(points - center, axis=1).max()),
        triangles=points[corners],
        planes=np.column_stack([normal, -(normal * first).sum(axis=1)]),
        is_open=asset_mesh(mesh).is_two_sided,
        edges=points[form.ends],
        along=form.along,
        against=form.against,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Form:
    """What of a mesh does not depend on where it stands; see ``MeshSolid``."""

    points: NDArray[np.float32]
    """(P, 3), each once, in the frame of the mesh."""
    corners: Ints
    """(T, 3), indices of points."""
    ends: Ints
    """(E, 2), indices of points."""
    along: Ints
    against: Ints


@lru_cache(maxsize=1024)
def _form(mesh: TriangleMesh) -> _Form:
    points, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = same.reshape(-1)[mesh.triangles].astype(np.int64)
    ends, along, against = _paired_edges(corners, len(points))
    return _Form(points=points, corners=corners, ends=ends, along=along, against=against)


def _paired_edges(corners: Ints, num_points: int) -> tuple[Ints, Ints, Ints]:
    """Ends (E, 2) of edges, each with a triangle that goes along it and one that goes against it, or none.

    Where more than two triangles meet, they are paired as they come: only their sum matters.
    """
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    owner = np.repeat(np.arange(len(corners)), 3)
    key = np.minimum(start, end) * num_points + np.maximum(start, end)
    halves = []
    for is_mine in (start < end, start > end):
        order = np.argsort(key[is_mine], kind="stable")
        keys, triangles = key[is_mine][order], owner[is_mine][order]
        # The n-th of several on one edge meets the n-th that goes the other way.
        turn = np.arange(len(keys)) - np.searchsorted(keys, keys)
        halves.append((keys * len(owner) + turn, triangles))
    names = np.union1d(halves[0][0], halves[1][0])
    sides = np.full((2, len(names)), len(corners))
    for side, (name, triangles) in zip(sides, halves, strict=True):
        side[np.searchsorted(names, name)] = triangles
    return np.stack(np.divmod(names // len(owner), num_points), axis=1), sides[0], sides[1]


def mesh_spans(solid: MeshSolid, camera: Camera, centers: Floats) -> tuple[Ints, Floats, Floats]:
    """What a mesh covers: rows, and where on each a run begins and ends, in pixels; runs may overlap.

    Triangles that reach behind the near plane are left out.

    Args:
        solid: The mesh.
        camera: The view.
        centers: (R,), ascending: the heights of the rows in the picture, in pixels.
    """
    pose = camera.camera_to_world
    is_front = solid.planes @ pose[:, 3] > 0
    is_back = solid.is_open & ~is_front
    if (solid.center - pose[:3, 3]) @ pose[:3, 2] - solid.radius_m <= camera.near_m:
        is_beyond = ((solid.triangles - pose[:3, 3]) @ pose[:3, 2] > camera.near_m).all(axis=1)
        # A body that is cut open is no longer closed.
        is_back = (is_back if is_beyond.all() else ~is_front) & is_beyond
        is_front &= is_beyond
    sheets = [sheet for sheet in (is_front, is_back) if sheet.any()]
    found = [_sheet_spans(solid, sheet, camera, centers) for sheet in sheets] or [_NOTHING]
    rows, left, right = (np.concatenate(values) for values in zip(*found, strict=True))
    return rows, left, right


_NOTHING: tuple[Ints, Floats, Floats] = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


def _sheet_spans(
    solid: MeshSolid, is_in: Bools, camera: Camera, centers: Floats
) -> tuple[Ints, Floats, Floats]:
    """The runs of one sheet: where its outline, walked from left to right, winds around the points."""
    counts = np.append(is_in, False).view(np.int8)
    winding = counts[solid.along] - counts[solid.against]
    outline = np.flatnonzero(winding)
    pose = camera.camera_to_world
    ends = (solid.edges[outline].reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]
    pixels = ends[:, :2] / ends[:, 2:] * camera.focal_px + (camera.width / 2, camera.height / 2)
    x, y = pixels.reshape(-1, 2, 2).transpose(2, 0, 1)
    at = np.searchsorted(centers, y)
    first, last = at.min(axis=1), at.max(axis=1)
    turn = winding[outline] * np.sign(at[:, 1] - at[:, 0])
    which = np.repeat(np.arange(len(outline)), last - first)
    row = np.arange(len(which)) - (np.cumsum(last - first) - last)[which]
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row
        slope = (x[:, 1] - x[:, 0]) / (y[:, 1] - y[:, 0])
    crossing = x[which, 0] + (centers[row] - y[which, 0]) * slope[which]
    # One number to sort by is several times as quick as two.
    crossing = np.clip(crossing, -MAX_OUTSIDE_PX, MAX_OUTSIDE_PX)
    order = np.argsort(crossing + row * (4.0 * MAX_OUTSIDE_PX))
    row, crossing = row[order], crossing[order]
    # Each row adds up to zero, so the sum over all rows one after another does for each.
    around = np.cumsum(turn[which][order])
    before = np.concatenate([[0], around[:-1]])
    begins, stops = (around != 0) & (before == 0), (around == 0) & (before != 0)
    return row[begins], crossing[begins], crossing[stops]
