"""All triangles of a scene as flat arrays, and which of them a camera can see.

NumPy only; shared by the renderers. The materials in the slots are not part of it: faces name textures by
number, the slots first, then the own materials of meshes; so one mesh serves every palette.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.meshes.triangles import Material
from langwm_data.scenes.spec import (
    IDENTITY,
    OWN,
    ObjectSpec,
    PartSpec,
    Quat,
    RoomSpec,
    SceneSpec,
    SurfaceSpec,
    Vec3,
)
from langwm_data.sim.asset_mesh import AssetMesh, asset_mesh
from langwm_data.sim.camera import Camera
from langwm_data.sim.mesh import Mesh, concatenate, part_mesh
from langwm_data.sim.screens import Screens, make_screens

LAMP_BELOW_CEILING_M = 0.35

SCENES_KEPT = 32
"""A process that goes from scene to scene makes each of them ready once."""

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneMesh:
    """Triangles in world coordinates: parts and meshes of surfaces, then of objects, in their order."""

    vertices: Floats
    """(V, 3), metres."""
    normals: Floats
    """(V, 3), unit length, outward."""
    uvs: Floats
    """(V, 2), metres along the surface."""
    triangles: Ints
    """(T, 3), counter-clockwise seen from outside."""
    faces: Ints
    """(V,), from 1; 0 stands for the background."""
    face_instance: NDArray[np.uint16]
    """(F + 1,), the instance id of each face; 0 for the background."""
    face_texture: Ints
    """(F + 1,), the texture of each face: a material slot, or past the last slot one of ``own``."""
    face_tile_m: Floats
    """(F + 1,), metres that one width of its own texture covers; 0 where the material of a slot decides."""
    face_lamp: Floats
    """(F + 1, 3), metres: the lamp that lights each face, which is that of its room."""
    own: tuple[Material, ...]
    """Materials that meshes bring along, each once."""
    planes: NDArray[np.float64]
    """(T, 4): a point x is before the triangle where planes @ (x, 1) > 0."""
    is_two_sided: NDArray[np.bool_]
    """(T,), whether a triangle can be seen from behind."""
    piece_triangles: NDArray[np.int64]
    """(P,), how many triangles each part or mesh has."""
    piece_center: NDArray[np.float64]
    """(P, 3), of the axis-aligned box around each, metres."""
    piece_half: NDArray[np.float64]
    """(P, 3), half the extent of that box, metres."""
    screens: Screens
    """What may hide whole pieces."""

    def visible_triangles(self, camera: Camera) -> Ints:
        """(N, 3): triangles that turn towards the camera, of pieces in its view that no wall hides."""
        in_view = np.flatnonzero(np.repeat(self._pieces_in_view(camera), self.piece_triangles))
        is_front = self.planes.take(in_view, axis=0) @ (*camera.position, 1.0) > 0
        return self.triangles.take(in_view[is_front | self.is_two_sided[in_view]], axis=0)

    def _pieces_in_view(self, camera: Camera) -> NDArray[np.bool_]:
        normals, offsets = _frustum_planes(camera)
        distance = normals @ self.piece_center.T + offsets[:, None]
        is_in_view = np.all(distance + np.abs(normals) @ self.piece_half.T > 0, axis=0)
        in_view = np.flatnonzero(is_in_view)
        center, half = self.piece_center.take(in_view, axis=0), self.piece_half.take(in_view, axis=0)
        is_in_view[in_view] = ~self.screens.hidden(camera, is_in_view, center, half)
        return is_in_view


@dataclass(frozen=True, kw_only=True, eq=False)
class _Piece:
    """One part, or one mesh, in world coordinates."""

    owner: SurfaceSpec | ObjectSpec
    mesh: Mesh
    textures: Ints
    """(F,), as ``SceneMesh.face_texture``."""
    tile_m: NDArray[np.float64]
    """(F,), as ``SceneMesh.face_tile_m``."""
    is_two_sided: NDArray[np.bool_]
    """(T,)."""


_Pose = tuple[Vec3, Quat]


def scene_mesh(scene: SceneSpec, assets: Assets = NO_ASSETS) -> SceneMesh:
    """The triangles of a scene; those of the last scenes asked for are kept, whatever their palette.

    Raises:
        ValueError: If a mesh of the scene is missing or damaged.
    """
    return _scene_mesh(dataclasses.replace(scene, palette=()), assets)


@lru_cache(maxsize=SCENES_KEPT)
def _scene_mesh(scene: SceneSpec, assets: Assets) -> SceneMesh:
    own: dict[Material, int] = {}
    pieces = list(_pieces(scene, assets, own))
    whole = concatenate([piece.mesh for piece in pieces])
    corner, second, third = np.moveaxis(whole.vertices[whole.triangles], 1, 0)
    normal = np.cross(second - corner, third - corner)
    bounds = np.array([(p.mesh.vertices.min(axis=0), p.mesh.vertices.max(axis=0)) for p in pieces])
    center = bounds.mean(axis=1)
    num_triangles = np.array([len(p.mesh.triangles) for p in pieces])
    num_faces = np.array([p.mesh.num_faces for p in pieces])
    instances = np.array([p.owner.instance for p in pieces])
    lamps = np.array(_lamps(scene, pieces, center))
    return SceneMesh(
        vertices=whole.vertices.astype(np.float32),
        normals=whole.normals.astype(np.float32),
        uvs=whole.uvs.astype(np.float32),
        triangles=whole.triangles,
        faces=whole.faces + 1,
        face_instance=_after_background(instances.repeat(num_faces).astype(np.uint16)),
        face_texture=_after_background(np.concatenate([p.textures for p in pieces])),
        face_tile_m=_after_background(np.concatenate([p.tile_m for p in pieces]).astype(np.float32)),
        face_lamp=_after_background(lamps.repeat(num_faces, axis=0).astype(np.float32)),
        own=tuple(own),
        planes=np.column_stack([normal, -(normal * corner).sum(axis=1)]),
        is_two_sided=np.concatenate([p.is_two_sided for p in pieces]),
        piece_triangles=num_triangles,
        piece_center=center,
        piece_half=bounds[:, 1] - center,
        screens=make_screens(_solid_walls(pieces)),
    )


def _pieces(scene: SceneSpec, assets: Assets, own: dict[Material, int]) -> Iterator[_Piece]:
    """What is drawn; the own materials of meshes are numbered in ``own`` as they come."""
    origin = ((0.0, 0.0, 0.0), IDENTITY)
    for s in scene.surfaces:
        if s.mesh is not None:
            yield _mesh_piece(scene, s, origin, asset_mesh(assets.mesh(s.mesh.name)), own)
        elif s.part is not None and s.is_seen:
            yield _part_piece(s, origin, s.part)
    for o in scene.objects:
        pose = (o.position, o.orientation)
        if o.mesh is not None:
            yield _mesh_piece(scene, o, pose, asset_mesh(assets.mesh(o.mesh.name)), own)
        else:
            for part in o.parts:
                yield _part_piece(o, pose, part)


def _part_piece(owner: SurfaceSpec | ObjectSpec, pose: _Pose, part: PartSpec) -> _Piece:
    mesh = part_mesh(part, along_grain=isinstance(owner, ObjectSpec)).transformed(*pose)
    return _Piece(
        owner=owner,
        mesh=mesh,
        textures=np.full(mesh.num_faces, part.slot, np.int32),
        tile_m=np.zeros(mesh.num_faces),
        is_two_sided=np.zeros(len(mesh.triangles), np.bool_),
    )


def _mesh_piece(
    scene: SceneSpec,
    owner: SurfaceSpec | ObjectSpec,
    pose: _Pose,
    drawn: AssetMesh,
    own: dict[Material, int],
) -> _Piece:
    assert owner.mesh is not None
    if len(owner.mesh.slots) != len(drawn.materials):
        raise ValueError(
            f"scene {scene.name!r}: mesh {owner.mesh.name} has {len(drawn.materials)} groups of triangles;"
            f" slots are named for {len(owner.mesh.slots)}"
        )
    textures = [
        len(scene.slots) + own.setdefault(material, len(own)) if slot == OWN else slot
        for slot, material in zip(owner.mesh.slots, drawn.materials, strict=True)
    ]
    is_own = np.array(owner.mesh.slots) == OWN
    return _Piece(
        owner=owner,
        mesh=drawn.mesh.transformed(*pose),
        textures=np.array(textures, np.int32)[drawn.face_group],
        tile_m=drawn.face_tile_m * is_own[drawn.face_group],
        is_two_sided=drawn.is_two_sided,
    )


def _solid_walls(pieces: list[_Piece]) -> Iterator[tuple[int, PartSpec]]:
    """Surfaces that are parts, by the number of their piece."""
    for number, piece in enumerate(pieces):
        owner = piece.owner
        if isinstance(owner, SurfaceSpec) and owner.mesh is None and owner.part is not None:
            yield number, owner.part


def _after_background(values: NDArray[Any]) -> NDArray[Any]:
    """Values of faces, a zero for the background first."""
    return np.concatenate([np.zeros_like(values[:1]), values])


def _lamps(
    scene: SceneSpec, pieces: list[_Piece], center: NDArray[np.float64]
) -> list[tuple[float, float, float]]:
    """Under the middle of the ceiling of the room of each piece; right above it in no room."""
    height = scene.height_m - LAMP_BELOW_CEILING_M
    rooms = {room.name: (*_middle(room), height) for room in scene.rooms}
    middles = center.tolist()
    return [
        rooms.get(piece.owner.room, (x, y, height)) for piece, (x, y, _) in zip(pieces, middles, strict=True)
    ]


def _middle(room: RoomSpec) -> tuple[float, float]:
    x0, y0, x1, y1 = room.rect
    return (x0 + x1) / 2, (y0 + y1) / 2


def _frustum_planes(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals (6, 3) pointing inwards and offsets (6,) of the planes around the field of view."""
    pose = camera.camera_to_world
    right, down, forward = pose[:3, :3].T
    x, y = camera.width / 2 / camera.focal_px, camera.height / 2 / camera.focal_px
    sides = [forward * x + right, forward * x - right, forward * y + down, forward * y - down]
    normals = np.array([*sides, forward, -forward])
    reach = np.array([0, 0, 0, 0, -camera.near_m, camera.far_m])
    return normals, reach - normals @ np.asarray(camera.position)
