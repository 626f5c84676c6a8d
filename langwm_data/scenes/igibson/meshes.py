"""Meshes of the dataset: OBJ with MTL beside it, and several of them made into one.

Source: iGibson 1.0 data_utils/README.md; Bullet's URDF importer (a convex hull for each group of an OBJ).
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from langwm_data.png import encode_png
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.meshes.images import texture_png
from langwm_data.scenes.meshes.mtl import MtlMaterial, parse_mtl
from langwm_data.scenes.meshes.obj import build_mesh, parse_obj
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh, fault
from langwm_data.scenes.spec import OWN, PartSpec, Vec3

Floats = NDArray[np.float64]

MIN_THICKNESS_M = 0.001
_DIGITS = 4
"""Corners of solids are kept to a tenth of a millimetre."""
_GREY = Material(color=(0.5, 0.5, 0.5))
"""Source: iGibson 1.0 mesh_renderer_cpu.py, what has no material."""
_WORN = Material(color=_GREY.color, texture=encode_png(np.full((1, 1, 3), 128, np.uint8)))
"""In the place of what a slot decides: texture coordinates are kept where there is a texture."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """An affine map from a file's frame to another."""

    matrix: Floats
    """(3, 3), with scales in it."""
    offset: Floats
    """(3,), metres."""

    def __call__(self, points: Floats) -> Floats:
        """The points (N, 3) in the other frame."""
        return points @ self.matrix.T + self.offset


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A mesh and, for each of its groups, the number of a slot or ``OWN``."""

    mesh: TriangleMesh
    slots: tuple[int, ...]


def read_piece(data: DataFolder, path: str, pose: Pose, slot: int) -> Piece:
    """The mesh of an OBJ file, moved; its own materials where ``slot`` is ``OWN``.

    A mesh without texture coordinates that is to wear materials gets some from its shape, in metres.

    Raises:
        ValueError: If it is missing, damaged or hostile.
    """
    obj = parse_obj(data.read(path), path)
    materials = dict.fromkeys(obj.material_names, _GREY if slot == OWN else _WORN)
    if slot == OWN:
        materials |= _own_materials(data, path, obj.libraries, obj.material_names)
    mesh = moved(build_mesh(obj, materials, path), pose)
    if slot != OWN and not mesh.uvs.any():
        mesh = replace(mesh, uvs=_flat_uvs(mesh))
    return Piece(mesh=mesh, slots=(slot,) * len(mesh.sizes))


def read_solids(data: DataFolder, path: str, pose: Pose) -> list[Floats]:
    """The corners (N, 3) of the convex solids of a collision mesh: one for each ``o`` or ``g`` of its OBJ.

    Raises:
        ValueError: If it is missing, damaged or hostile.
    """
    obj = parse_obj(_groups_as_materials(data.read(path)), path)
    group = np.repeat(obj.material, obj.lengths)
    points = pose(obj.vertices)
    solids = [points[np.unique(obj.corners[group == number, 0])] for number in range(len(obj.material_names))]
    return [solid for solid in solids if len(solid)]


def joined(pieces: Iterable[Piece]) -> Piece:
    """All pieces as one; groups of one slot, or of one material, become one group.

    Raises:
        ValueError: If that is too much for a mesh; the message is the end of a sentence.
    """
    parts: dict[tuple[int, Material | None], list[tuple[TriangleMesh, int]]] = {}
    for piece in pieces:
        for number, (slot, material) in enumerate(zip(piece.slots, piece.mesh.materials, strict=True)):
            key = (slot, material if slot == OWN else None)
            parts.setdefault(key, []).append((piece.mesh, number))
    groups = [_group(mesh, number) for members in parts.values() for mesh, number in members]
    starts = np.cumsum([0, *(len(group.vertices) for group in groups[:-1])])
    triangles = [group.triangles + start for group, start in zip(groups, starts, strict=True)]
    mesh = TriangleMesh(
        vertices=np.concatenate([group.vertices for group in groups]),
        normals=np.concatenate([group.normals for group in groups]),
        uvs=np.concatenate([group.uvs for group in groups]),
        triangles=np.concatenate(triangles).astype(np.int32),
        sizes=tuple(sum(mesh.sizes[n] for mesh, n in members) for members in parts.values()),
        materials=tuple(material or _GREY for _, material in parts),
    )
    problem = fault(mesh)
    if problem is not None:
        raise ValueError(problem)
    return Piece(mesh=mesh, slots=tuple(slot for slot, _ in parts))


def cut(piece: Piece, owner: Sequence[int] | NDArray[np.integer]) -> dict[int, Piece]:
    """The triangles of a piece by owner, given for each; owners in ascending order."""
    group, owners = piece.mesh.group_of_triangles(), np.asarray(owner)
    pieces = {}
    for number in np.unique(owners).tolist():
        is_its = owners == number
        slots = tuple(piece.slots[i] for i in np.unique(group[is_its]))
        pieces[number] = Piece(mesh=piece.mesh.part(is_its), slots=slots)
    return pieces


def moved(mesh: TriangleMesh, pose: Pose) -> TriangleMesh:
    """A mesh in another frame, its normals still at right angles to it."""
    normals = mesh.normals.astype(np.float64) @ np.linalg.inv(pose.matrix)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    is_mirrored = np.linalg.det(pose.matrix) < 0
    return replace(
        mesh,
        vertices=pose(mesh.vertices.astype(np.float64)).astype(np.float32),
        normals=(normals / np.where(lengths > 0, lengths, 1)).astype(np.float32),
        triangles=mesh.triangles[:, ::-1] if is_mirrored else mesh.triangles,
    )


def solid_part(points: Floats, slot: int) -> PartSpec:
    """The convex hull of points (N, 3) as a part: a box where it is one or has no thickness."""
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, MIN_THICKNESS_M)
    size, center = _vec3(extent), _vec3((low + high) / 2)
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError:
        corners = np.empty((0, 3))
    is_at_corner = (np.isclose(corners, low, atol=1e-5) | np.isclose(corners, high, atol=1e-5)).all()
    if len(corners) == 0 or (len(corners) == 8 and is_at_corner):
        return PartSpec(shape="box", size=size, position=center, slot=slot)
    relative = np.unique(np.round(corners - center, _DIGITS), axis=0)
    return PartSpec(
        shape="hull", size=size, position=center, slot=slot, points=tuple(_vec3(p) for p in relative)
    )


def _vec3(values: Floats) -> Vec3:
    x, y, z = np.round(values, _DIGITS + 2).tolist()
    return (x, y, z)


def _flat_uvs(mesh: TriangleMesh) -> NDArray[np.float32]:
    """(V, 2), metres along the two axes that a vertex faces least, v upwards on walls."""
    facing = np.abs(mesh.normals).argmax(axis=1)
    return np.take_along_axis(mesh.vertices, np.array([(1, 2), (0, 2), (0, 1)])[facing], axis=1)


def _own_materials(
    data: DataFolder, path: str, libraries: Sequence[str], names: Sequence[str]
) -> dict[str, Material]:
    materials = {}
    for library in libraries:
        file = data.beside(path, library)
        described = parse_mtl(data.read(file), file)
        materials |= {n: _material(data, file, described[n]) for n in names if n in described}
    return materials


def _material(data: DataFolder, file: str, material: MtlMaterial) -> Material:
    if material.texture is None:
        return Material(color=material.color, opacity=material.opacity)
    picture = data.beside(file, material.texture)
    png = texture_png(data.read(picture), picture)
    return Material(color=material.color, opacity=material.opacity, texture=png)


def _group(mesh: TriangleMesh, number: int) -> TriangleMesh:
    return mesh.part(mesh.group_of_triangles() == number)


def _groups_as_materials(data: bytes) -> bytes:
    """An OBJ text in which every object or group has a material of its own, and no other is named."""
    count = 0

    def numbered(_: re.Match[bytes]) -> bytes:
        nonlocal count
        count += 1
        return b"usemtl %d" % count

    without = re.sub(rb"(?m)^[ \t]*usemtl\b.*$", b"", data)
    return re.sub(rb"(?m)^[ \t]*[og](?=\s).*$", numbered, without)
