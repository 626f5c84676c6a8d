"""How much of each object a picture shows: what something hides, and what lies outside the picture.

Owns silhouettes. An object's silhouette is what it would cover if it stood alone and the picture had no
edges. Every part is convex, so it covers one span of each pixel row; the spans of an object's parts,
united, are its silhouette. A pixel belongs to what lies at its centre, as the renderers have it. Rows
far outside the picture are higher than a pixel.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.spec import PartSpec, Quat, SceneSpec, Shape, Vec3
from langwm_data.sim.camera import Camera
from langwm_data.sim.mesh import part_mesh

MAX_OUTSIDE_PX = 100_000
"""Silhouettes are cut this far from the picture: near the camera's own plane they would have no end."""
_ROW_GROWTH = 16
"""A row outside the picture is as high as its distance from it divided by this, and at least one pixel:
what is truncated is right to one part in a hundred."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class AmodalExtent:
    """Shares of one object's silhouette, 0 to 1; visible = (1 - truncated) * (1 - occluded)."""

    visible_fraction: float
    """Visible pixels / pixels of the silhouette, of which some may lie outside the picture."""
    truncated_fraction: float
    """Share of the silhouette that lies outside the picture."""
    occluded_fraction: float
    """Share of the silhouette inside the picture that something else hides."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """Convex parts as the edges at which their flat faces meet."""

    ends: Floats
    """(E, 2, 3), where each edge starts and stops, metres."""
    planes: Floats
    """(E, 2, 4), of the two faces of each edge: a point x lies before one where planes @ (x, 1) > 0."""
    faces: Ints
    """(E, 2), numbers of these faces, from 0, less than E."""
    parts: Ints
    """(E,), the part of each edge, from 0, ascending."""

    @property
    def num_parts(self) -> int:
        """How many parts there are."""
        return int(self.parts[-1]) + 1


def scene_solids(scene: SceneSpec) -> dict[int, Solid]:
    """Everything that a mask can show, by instance id, in world coordinates; good for any number of views."""
    solids: defaultdict[int, list[Solid]] = defaultdict(list)
    for instance, position, orientation, part in scene.iter_parts():
        solids[instance].append(_part_solid(position, orientation, part))
    return {instance: _join(parts) for instance, parts in solids.items()}


def amodal_extents(
    solids: Mapping[int, Solid], camera: Camera, visible_px: Mapping[int, int]
) -> dict[int, AmodalExtent]:
    """What a view shows of each object that is visible in it.

    Args:
        solids: Those of the scene.
        camera: The view; only what lies beyond its near plane counts.
        visible_px: Visible pixels by instance id, at least one each.

    Source: ours.
    """
    if not visible_px:
        return {}
    shown = [solids[number] for number in visible_px]
    owner_of_part = np.repeat(np.arange(len(shown)), [solid.num_parts for solid in shown])
    areas = _areas(*_outlines(_join(shown), camera), owner_of_part, camera)
    extents = {}
    for (number, visible), (inside, outside) in zip(visible_px.items(), areas.tolist(), strict=True):
        # Where rasterisers differ about a pixel of the outline, what is seen is there.
        inside = max(inside, float(visible))
        extents[number] = AmodalExtent(
            visible_fraction=visible / (inside + outside),
            truncated_fraction=outside / (inside + outside),
            occluded_fraction=1 - visible / inside,
        )
    return extents


def _part_solid(position: Vec3, orientation: Quat, part: PartSpec) -> Solid:
    """One part in world coordinates."""
    if part.shape == "box":
        local, size = _hull("box", (1.0, 1.0, 1.0), 1.0), np.asarray(part.size)
    else:
        local, size = _hull(part.shape, part.size, part.taper), np.ones(3)
    rotation = quat_matrix(orientation)
    shift = rotation @ np.asarray(part.position) + position
    rotation = rotation @ quat_matrix(part.orientation)
    normals = local.planes[..., :3] / size @ rotation.T
    return Solid(
        ends=local.ends * size @ rotation.T + shift,
        planes=np.concatenate([normals, local.planes[..., 3:] - (normals @ shift)[..., None]], axis=-1),
        faces=local.faces,
        parts=local.parts,
    )


@lru_cache(maxsize=4096)
def _hull(shape: Shape, size: Vec3, taper: float) -> Solid:
    """A part of this shape around the origin, as the renderers draw it."""
    part = PartSpec(shape=shape, size=size, position=(0.0, 0.0, 0.0), slot=0, taper=taper)
    points = part_mesh(part).vertices
    hull = ConvexHull(points)
    planes, face_of = np.unique(hull.equations, axis=0, return_inverse=True)
    # Qhull's triangles: the n-th neighbour lies across the edge opposite the n-th corner.
    ends = np.concatenate([hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]], hull.simplices[:, [0, 1]]])
    faces = np.stack([np.tile(face_of, 3), face_of[hull.neighbors.T.ravel()]], axis=1)
    is_edge = faces[:, 0] < faces[:, 1]  # each edge once, and none inside a face
    ends, faces = ends[is_edge], faces[is_edge]
    parts = np.zeros(len(ends), np.int64)
    return Solid(ends=points[ends], planes=planes[faces], faces=faces, parts=parts)


def _join(solids: Sequence[Solid]) -> Solid:
    """Several solids as one, their parts numbered on."""
    num_edges = [len(solid.parts) for solid in solids]
    first_edge = np.cumsum([0, *num_edges[:-1]])  # a convex part has fewer faces than edges
    first_part = np.cumsum([0, *(solid.num_parts for solid in solids[:-1])])
    return Solid(
        ends=np.concatenate([solid.ends for solid in solids]),
        planes=np.concatenate([solid.planes for solid in solids]),
        faces=np.concatenate([solid.faces for solid in solids]) + np.repeat(first_edge, num_edges)[:, None],
        parts=np.concatenate([solid.parts for solid in solids]) + np.repeat(first_part, num_edges),
    )


def _outlines(solid: Solid, camera: Camera) -> tuple[Floats, Ints]:
    """What parts cover in the image plane: segments (N, 2 ends, 2) in pixels, and the part of each.

    Those of one part make a closed loop: the edges between a face that looks at the camera and one that
    does not, and where the near plane cuts the part, the cuts through faces that do not.
    """
    pose = camera.camera_to_world
    is_front = solid.planes @ pose[:, 3] > 0
    ends = (solid.ends - pose[:3, 3]) @ pose[:3, :3]
    is_near = ends[..., 2] < camera.near_m
    is_cut = is_near[:, 0] != is_near[:, 1]
    ends[is_cut] = _cut(ends[is_cut], is_near[is_cut], camera.near_m)
    is_outline = (is_front[:, 0] != is_front[:, 1]) & ~is_near.all(axis=1)
    # A plane cuts two edges of each convex face that it cuts: sorted by face, they stand in pairs.
    edge, side = np.nonzero(is_cut[:, None] & ~is_front)
    edge = edge[np.argsort(solid.faces[edge, side], kind="stable")]
    cuts = ends[edge, is_near[edge, 1].astype(int)].reshape(-1, 2, 3)
    local = np.concatenate([ends[is_outline], cuts])
    pixels = local[..., :2] / local[..., 2:] * camera.focal_px + (camera.width / 2, camera.height / 2)
    return pixels, np.concatenate([solid.parts[is_outline], solid.parts[edge[::2]]])


def _cut(ends: Floats, is_near: Bools, near_m: float) -> Floats:
    """Segments (N, 2, 3) with the end that is too near moved to the near plane."""
    start, stop = ends[:, 0], ends[:, 1]
    share = (near_m - start[:, 2]) / (stop[:, 2] - start[:, 2])
    crossing = start + share[:, None] * (stop - start)
    return np.where(is_near[..., None], crossing[:, None], ends)


def _areas(segments: Floats, parts: Ints, owner_of_part: Ints, camera: Camera) -> Floats:
    """Pixels inside and outside the picture, (N, 2), that the parts of each owner cover together."""
    centers, heights = _rows(camera.height)
    part, row, left, right = _spans(segments, parts, len(owner_of_part), centers)
    group = owner_of_part[part] * len(centers) + row
    # Side by side on one line, the rows of all owners in turn: from left to right, each span adds what
    # lies beyond all before it.
    shift = group * (4.0 * MAX_OUTSIDE_PX)
    order = np.argsort(left + shift)
    group, row, shift, left, right = group[order], row[order], shift[order], left[order], right[order]
    left[1:] = np.maximum(left[1:], np.maximum.accumulate(right + shift)[:-1] - shift[1:])
    whole = np.maximum(right - left, 0) * heights[row]
    inside = np.maximum(np.minimum(right, camera.width) - np.maximum(left, 0), 0)
    inside *= (centers[row] > 0) & (centers[row] < camera.height)
    owner, num_owners = group // len(centers), int(owner_of_part[-1]) + 1
    sums = [np.bincount(owner, area, num_owners) for area in (inside, whole - inside)]
    return np.stack(sums, axis=1, dtype=np.float64)


def _spans(
    segments: Floats, parts: Ints, num_parts: int, centers: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Every run of pixel centres inside an outline: part, row, first column, and the one after the last."""
    x, y = segments[..., 0], segments[..., 1]
    first, last = np.sort(np.searchsorted(centers, y), axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row
        slope = (x[:, 1] - x[:, 0]) / (y[:, 1] - y[:, 0])
    which = np.repeat(np.arange(len(segments)), last - first)
    row = np.arange(len(which)) - (np.cumsum(last - first) - last)[which]
    crossing = x[which, 0] + (centers[row] - y[which, 0]) * slope[which]
    place = parts[which] * len(centers) + row
    left, right = np.full((2, num_parts * len(centers)), ((np.inf,), (-np.inf,)))
    np.minimum.at(left, place, crossing)
    np.maximum.at(right, place, crossing)
    used = np.flatnonzero(left < right)
    left, right = np.ceil(np.clip((left[used], right[used]), -MAX_OUTSIDE_PX, MAX_OUTSIDE_PX) - 0.5)
    return used // len(centers), used % len(centers), left, right


@lru_cache(maxsize=8)
def _rows(height: int) -> tuple[Floats, Floats]:
    """Centres and heights of the rows that silhouettes are measured on, from top to bottom, in pixels."""
    borders = [0]
    while borders[-1] < MAX_OUTSIDE_PX:
        borders.append(borders[-1] + max(borders[-1] // _ROW_GROWTH, 1))
    above = -np.array(borders[:0:-1], dtype=np.float64)
    below = height + np.array(borders[1:], dtype=np.float64)
    all_borders = np.concatenate([above, np.arange(height + 1), below])
    return (all_borders[1:] + all_borders[:-1]) / 2, np.diff(all_borders)
