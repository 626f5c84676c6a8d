"""All triangles of a scene as flat arrays, and which of them a camera can see.

NumPy only; shared by the renderers that draw from memory. Materials are not part of it: vertices name
slots, so one mesh serves every palette.
"""

import dataclasses
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.spec import RoomSpec, SceneSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.mesh import concatenate, part_mesh

LAMP_BELOW_CEILING_M = 0.35

SCENES_KEPT = 32
"""A process that goes from scene to scene makes each of them ready once."""

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneMesh:
    """Triangles in world coordinates, parts in the order of ``SceneSpec.iter_parts``."""

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
    face_slot: Ints
    """(F + 1,), the material slot of each face."""
    face_lamp: Floats
    """(F + 1, 3), metres: the lamp that lights each face, which is that of its room."""
    planes: NDArray[np.float64]
    """(T, 4): a point x is before the triangle where planes @ (x, 1) > 0."""
    part_triangles: NDArray[np.int64]
    """(P,), how many triangles each part has."""
    part_center: NDArray[np.float64]
    """(P, 3), of the axis-aligned box around each part, metres."""
    part_half: NDArray[np.float64]
    """(P, 3), half the extent of that box, metres."""

    def visible_triangles(self, camera: Camera) -> Ints:
        """(N, 3): triangles that turn towards the camera, of parts that reach into its field of view."""
        eye = np.append(camera.position, 1.0)
        is_seen = np.repeat(self._parts_in_view(camera), self.part_triangles)
        is_seen &= self.planes @ eye > 0
        return self.triangles[is_seen]

    def _parts_in_view(self, camera: Camera) -> NDArray[np.bool_]:
        normals, offsets = _frustum_planes(camera)
        distance = self.part_center @ normals.T + offsets
        return np.all(distance + self.part_half @ np.abs(normals).T > 0, axis=1)


def scene_mesh(scene: SceneSpec) -> SceneMesh:
    """The triangles of a scene; those of the last scenes asked for are kept, whatever their palette."""
    return _scene_mesh(dataclasses.replace(scene, palette=()))


@lru_cache(maxsize=SCENES_KEPT)
def _scene_mesh(scene: SceneSpec) -> SceneMesh:
    surfaces = {s.instance for s in scene.surfaces}
    owners = list(scene.iter_parts())
    meshes = [
        part_mesh(part, along_grain=instance not in surfaces).transformed(position, orientation)
        for instance, position, orientation, part in owners
    ]
    whole = concatenate(meshes)
    corner, second, third = np.moveaxis(whole.vertices[whole.triangles], 1, 0)
    normal = np.cross(second - corner, third - corner)
    bounds = np.array([(m.vertices.min(axis=0), m.vertices.max(axis=0)) for m in meshes])
    num_faces = [m.num_faces for m in meshes]
    center = bounds.mean(axis=1)
    return SceneMesh(
        vertices=whole.vertices.astype(np.float32),
        normals=whole.normals.astype(np.float32),
        uvs=whole.uvs.astype(np.float32),
        triangles=whole.triangles,
        faces=whole.faces + 1,
        face_instance=_per_face([o[0] for o in owners], num_faces).astype(np.uint16),
        face_slot=_per_face([o[3].slot for o in owners], num_faces).astype(np.int32),
        face_lamp=_per_face(_lamps(scene, center), num_faces).astype(np.float32),
        planes=np.column_stack([normal, -(normal * corner).sum(axis=1)]),
        part_triangles=np.array([len(m.triangles) for m in meshes]),
        part_center=center,
        part_half=bounds[:, 1] - center,
    )


def _per_face(values: list[int] | NDArray[np.float64], num_faces: list[int]) -> NDArray[np.float64]:
    """Values of parts as values of faces, the background first."""
    repeated = np.repeat(np.asarray(values, np.float64), num_faces, axis=0)
    return np.concatenate([np.zeros_like(repeated[:1]), repeated])


def _lamps(scene: SceneSpec, part_center: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 3): under the middle of the ceiling of the room of each part; right above it in no room."""
    height = scene.height_m - LAMP_BELOW_CEILING_M
    rooms = {room.name: (*_middle(room), height) for room in scene.rooms}
    names = [s.room for s in scene.surfaces]
    names += [o.room for o in scene.objects for _ in o.parts]
    own = [rooms.get(name, (x, y, height)) for name, (x, y, _) in zip(names, part_center, strict=True)]
    return np.array(own)


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
