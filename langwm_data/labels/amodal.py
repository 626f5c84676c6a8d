"""How much of each object a picture shows: what something hides, and what lies outside the picture.

Owns silhouettes. An object's silhouette is what it would cover if it stood alone and the picture had no
edges. Every part is convex, so it covers one run of each pixel row; meshes stand in ``mesh_outline``. The
runs of an object, united, are its silhouette. A pixel belongs to what lies at its centre, as the renderers
have it. Rows far outside the picture are higher than a pixel.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from langwm_data.labels.mesh_outline import MAX_OUTSIDE_PX, MeshSolid, mesh_solid, mesh_spans
from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.spec import IDENTITY, PartSpec, Quat, SceneSpec, Shape, Vec3
from langwm_data.sim.camera import Camera
from langwm_data.sim.mesh import part_mesh

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


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneSolids:
    """Everything that a mask can show, by instance id, in world coordinates; good for any number of views."""

    parts: Mapping[int, Solid]
    meshes: Mapping[int, Sequence[MeshSolid]]


def scene_solids(scene: SceneSpec, assets: Assets = NO_ASSETS) -> SceneSolids:
    """What the renderers draw of a scene.

    Raises:
        ValueError: If a mesh of the scene is missing or damaged.
    """
    parts: defaultdict[int, list[Solid]] = defaultdict(list)
    meshes: defaultdict[int, list[MeshSolid]] = defaultdict(list)
    for s in scene.surfaces:
        if s.mesh is not None:
            meshes[s.instance].append(mesh_solid(assets.mesh(s.mesh.name), (0.0, 0.0, 0.0), IDENTITY))
        elif s.part is not None and s.is_seen:
            parts[s.instance].append(_part_solid((0.0, 0.0, 0.0), IDENTITY, s.part))
    for o in scene.objects:
        if o.mesh is not None:
            meshes[o.instance].append(mesh_solid(assets.mesh(o.mesh.name), o.position, o.orientation))
        else:
            parts[o.instance] += [_part_solid(o.position, o.orientation, part) for part in o.parts]
    return SceneSolids(
        parts={instance: _join(solids) for instance, solids in parts.items()}, meshes=dict(meshes)
    )


def amodal_extents(
    solids: SceneSolids, camera: Camera, visible_px: Mapping[int, int]
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
    areas = _areas(*_all_spans(solids, list(visible_px), camera), len(visible_px), camera)
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
        local, size = _hull("box", (1.0, 1.0, 1.0), 1.0, ()), np.asarray(part.size)
    else:
        local, size = _hull(part.shape, part.size, part.taper, part.points), np.ones(3)
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
def _hull(shape: Shape, size: Vec3, taper: float, points: tuple[Vec3, ...]) -> Solid:
    """A part of this shape around the origin, as the renderers draw it."""
    part = PartSpec(shape=shape, size=size, position=(0.0, 0.0, 0.0), slot=0, taper=taper, points=points)
    corners = part_mesh(part).vertices
    hull = ConvexHull(corners)
    planes, face_of = np.unique(hull.equations, axis=0, return_inverse=True)
    # Qhull's triangles: the n-th neighbour lies across the edge opposite the n-th corner.
    ends = np.concatenate([hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]], hull.simplices[:, [0, 1]]])
    faces = np.stack([np.tile(face_of, 3), face_of[hull.neighbors.T.ravel()]], axis=1)
    is_edge = faces[:, 0] < faces[:, 1]  # each edge once, and none inside a face
    ends, faces = ends[is_edge], faces[is_edge]
    parts = np.zeros(len(ends), np.int64)
    return Solid(ends=corners[ends], planes=planes[faces], faces=faces, parts=parts)


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
    # As matrices of two dimensions: many small products take three times as long as one large one.
    is_front = (solid.planes.reshape(-1, 4) @ pose[:, 3]).reshape(-1, 2) > 0
    ends = ((solid.ends.reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]).reshape(-1, 2, 3)
    is_near = ends[..., 2] < camera.near_m
    cut = np.flatnonzero(is_near[:, 0] != is_near[:, 1])
    ends[cut] = _cut(ends.take(cut, axis=0), is_near.take(cut, axis=0), camera.near_m)
    is_outline = (is_front[:, 0] != is_front[:, 1]) & ~(is_near[:, 0] & is_near[:, 1])
    outline = np.flatnonzero(is_outline)
    # A plane cuts two edges of each convex face that it cuts: sorted by face, they stand in pairs.
    edge, side = np.nonzero(~is_front.take(cut, axis=0))
    edge = cut.take(edge)
    edge = edge.take(np.argsort(solid.faces[edge, side], kind="stable"))
    cuts = ends[edge, is_near[edge, 1].astype(np.intp)].reshape(-1, 2, 3)
    local = np.concatenate([ends.take(outline, axis=0), cuts])
    pixels = local[..., :2] / local[..., 2:] * camera.focal_px + (camera.width / 2, camera.height / 2)
    return pixels, np.concatenate([solid.parts.take(outline), solid.parts.take(edge[::2])])


def _cut(ends: Floats, is_near: Bools, near_m: float) -> Floats:
    """Segments (N, 2, 3) with the end that is too near moved to the near plane."""
    start, stop = ends[:, 0], ends[:, 1]
    share = (near_m - start[:, 2]) / (stop[:, 2] - start[:, 2])
    crossing = start + share[:, None] * (stop - start)
    return np.where(is_near[..., None], crossing[:, None], ends)


def _all_spans(
    solids: SceneSolids, numbers: Sequence[int], camera: Camera
) -> tuple[Ints, Ints, Floats, Floats]:
    """Every run of pixel centres that a part or a sheet of a mesh covers: owner, counted as in ``numbers``,
    row, first column, and the one after the last.
    """
    centers, _ = _rows(camera.height)
    owners = [i for i, number in enumerate(numbers) if number in solids.parts]
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))]
    if owners:
        shown = [solids.parts[numbers[i]] for i in owners]
        owner_of_part = np.repeat(owners, [solid.num_parts for solid in shown])
        part, row, left, right = _spans(*_outlines(_join(shown), camera), centers)
        found.append((owner_of_part[part], row, left, right))
    for i, number in enumerate(numbers):
        for solid in solids.meshes.get(number, ()):
            row, left, right = mesh_spans(solid, camera, centers)
            found.append((np.full(len(row), i), row, left, right))
    owner, row, left, right = (np.concatenate(values) for values in zip(*found, strict=True))
    left, right = np.ceil(np.clip((left, right), -MAX_OUTSIDE_PX, MAX_OUTSIDE_PX) - 0.5)
    return owner, row, left, right


def _areas(owner: Ints, row: Ints, left: Floats, right: Floats, num_owners: int, camera: Camera) -> Floats:
    """Pixels inside and outside the picture, (N, 2), that the runs of each owner cover together."""
    centers, heights = _rows(camera.height)
    # Side by side on one line, the rows of all owners in turn: from left to right, each span adds what
    # lies beyond all before it.
    shift = (owner * len(centers) + row) * (4.0 * MAX_OUTSIDE_PX)
    order = np.argsort(left + shift, kind="stable")  # quick, because most are in order
    owner, row, shift = owner.take(order), row.take(order), shift.take(order)
    left, right = left.take(order), right.take(order)
    left[1:] = np.maximum(left[1:], np.maximum.accumulate(right + shift)[:-1] - shift[1:])
    whole = np.maximum(right - left, 0) * heights[row]
    inside = np.maximum(np.minimum(right, camera.width) - np.maximum(left, 0), 0)
    inside *= (centers[row] > 0) & (centers[row] < camera.height)
    sums = [np.bincount(owner, area, num_owners) for area in (inside, whole - inside)]
    return np.stack(sums, axis=1, dtype=np.float64)


def _spans(segments: Floats, parts: Ints, centers: Floats) -> tuple[Ints, Ints, Floats, Floats]:
    """Every run inside the outline of a convex part: part, row, and where it begins and ends, in pixels."""
    x, y = segments[..., 0], segments[..., 1]
    at = np.searchsorted(centers, y)
    first, count = np.minimum(at[:, 0], at[:, 1]), np.abs(at[:, 1] - at[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row
        slope = (x[:, 1] - x[:, 0]) / (y[:, 1] - y[:, 0])
    which = np.repeat(np.arange(len(segments)), count)
    row = np.arange(len(which)) + (first - np.cumsum(count) + count).take(which)
    crossing = x[:, 0].take(which) + (centers.take(row) - y[:, 0].take(which)) * slope.take(which)
    place = parts.take(which) * len(centers) + row
    order = np.argsort(place, kind="stable")
    place, crossing = place.take(order), crossing.take(order)
    # A loop around something convex crosses a row twice or not at all.
    start = np.flatnonzero(place[1:] == place[:-1])
    one, other = crossing.take(start), crossing.take(start + 1)
    part, row = np.divmod(place.take(start), len(centers))
    return part, row, np.minimum(one, other), np.maximum(one, other)


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
