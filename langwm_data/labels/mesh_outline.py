"""Silhouettes of meshes, neither convex nor closed: which pixel rows they cover, from where to where.

A mesh is looked at as two sheets, the triangles that turn towards the camera and those that turn away; a
sheet covers a point of the picture where its outline winds around it. Edges inside a sheet cancel, so only
the outline is projected, which is a small part of the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.scenes.spec import Quat, Vec3
from langwm_data.sim.camera import Camera

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshSolid:
    """A mesh in world coordinates, its vertices at one place made one."""

    points: Floats
    """(P, 3), metres."""
    triangles: Ints
    """(T, 3), indices of points."""
    planes: Floats
    """(T, 4): a point x lies before a triangle where planes @ (x, 1) > 0."""
    edges: Ints
    """(E, 2), the points that each edge joins, the lower number first."""
    edge_of: Ints
    """(T, 3), the edge from each corner to the next."""
    direction: Floats
    """(T, 3), 1 where the triangle goes along its edge, -1 where against it."""


def mesh_solid(mesh: TriangleMesh, position: Vec3, orientation: Quat) -> MeshSolid:
    """What silhouettes need of a mesh that stands somewhere."""
    places = mesh.vertices.astype(np.float64) @ quat_matrix(orientation).T + position
    points, same = np.unique(places, axis=0, return_inverse=True)
    triangles = same.reshape(-1)[mesh.triangles].astype(np.int64)
    corner, second, third = np.moveaxis(points[triangles], 1, 0)
    normal = np.cross(second - corner, third - corner)
    start, end = triangles, np.roll(triangles, -1, axis=1)
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    edges, edge_of = np.unique(key, return_inverse=True)
    return MeshSolid(
        points=points,
        triangles=triangles,
        planes=np.column_stack([normal, -(normal * corner).sum(axis=1)]),
        edges=np.stack(np.divmod(edges, len(points)), axis=1),
        edge_of=edge_of.reshape(-1, 3),
        direction=np.where(start < end, 1.0, -1.0),
    )


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
    local = (solid.points - pose[:3, 3]) @ pose[:3, :3]
    is_beyond = (local[:, 2] > camera.near_m)[solid.triangles].all(axis=1)
    found = [
        _sheet_spans(solid, local, is_beyond & is_sheet, camera, centers)
        for is_sheet in (is_front, ~is_front)
    ]
    rows, left, right = (np.concatenate(values) for values in zip(*found, strict=True))
    return rows, left, right


def _sheet_spans(
    solid: MeshSolid, local: Floats, is_in: NDArray[np.bool_], camera: Camera, centers: Floats
) -> tuple[Ints, Floats, Floats]:
    """The runs of one sheet: where its outline, walked from left to right, winds around the points."""
    winding = np.bincount(
        solid.edge_of[is_in].ravel(), solid.direction[is_in].ravel(), minlength=len(solid.edges)
    )
    outline = np.flatnonzero(winding)
    ends = local[solid.edges[outline]]
    middle = (camera.width / 2, camera.height / 2)
    pixels = ends[..., :2] / ends[..., 2:] * camera.focal_px + middle
    x, y = pixels[..., 0], pixels[..., 1]
    at = np.searchsorted(centers, y)
    first, last = at.min(axis=1), at.max(axis=1)
    turn = winding[outline] * np.sign(at[:, 1] - at[:, 0])
    which = np.repeat(np.arange(len(outline)), last - first)
    row = np.arange(len(which)) - (np.cumsum(last - first) - last)[which]
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row
        slope = (x[:, 1] - x[:, 0]) / (y[:, 1] - y[:, 0])
    crossing = x[which, 0] + (centers[row] - y[which, 0]) * slope[which]
    order = np.lexsort((crossing, row))
    row, crossing = row[order], crossing[order]
    # Each row adds up to zero, so the sum over all rows one after another does for each.
    around = np.rint(np.cumsum(turn[which][order])).astype(np.int64)
    begins = (around != 0) & (np.concatenate([[0], around[:-1]]) == 0)
    stops = (around == 0) & (np.concatenate([[0], around[:-1]]) != 0)
    return row[begins], crossing[begins], crossing[stops]
