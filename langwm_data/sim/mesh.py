"""From scene parts to triangles that any renderer can draw: vertices, normals, metric texture coordinates.

NumPy only. Which texture goes on a mesh, and how large one tile of it is, is the renderer's business.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.spec import IDENTITY, PartSpec, Quat, Vec3

MAX_CHORD_ERROR_M = 0.003
"""How far a round side may lie inside the true circle."""
MIN_SEGMENTS, MAX_SEGMENTS = 8, 32
_UPRIGHT = 0.99
"""A face of a hull is level where its normal's z is larger; it then has no upward direction of its own."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside."""

    vertices: Floats
    """(V, 3), metres."""
    normals: Floats
    """(V, 3), unit length, outward."""
    uvs: Floats
    """(V, 2), metres along the surface: u to the right, v upwards, seen from outside; may be negative."""
    triangles: Ints
    """(T, 3), indices of vertices."""
    faces: Ints
    """(V,), from 0: the flat or smoothly curved face that a vertex belongs to. Each is convex, but those of
    ``scene_mesh``'s assets need not be."""

    @property
    def num_faces(self) -> int:
        """How many faces there are."""
        return int(self.faces[-1]) + 1

    def transformed(self, position: Vec3, orientation: Quat) -> "Mesh":
        """The mesh moved rigidly; texture coordinates go along with it."""
        vertices, normals = self.vertices, self.normals
        if orientation != IDENTITY:
            rotation = quat_matrix(orientation)
            vertices, normals = vertices @ rotation.T, normals @ rotation.T
        return Mesh(
            vertices=vertices + np.asarray(position),
            normals=normals,
            uvs=self.uvs,
            triangles=self.triangles,
            faces=self.faces,
        )


def part_mesh(part: PartSpec, *, along_grain: bool = False) -> Mesh:
    """One part as triangles in the frame of its owner.

    Args:
        part: The primitive.
        along_grain: Turn texture coordinates so that u runs along the longer side of each face, as
            wood is cut; otherwise v points up on upright faces, as walls are built.
    """
    if part.shape == "box":
        # The part's place in its owner sets the phase, so that textures run on across coplanar pieces.
        offset = quat_matrix(part.orientation).T @ np.asarray(part.position)
        mesh = _box(part.size, offset, along_grain=along_grain)
    elif part.shape == "hull":
        mesh = _hull(part.points)
    elif part.shape == "ellipsoid":
        mesh = _ellipsoid(part.size)
    else:
        taper = part.taper if part.shape == "frustum" else 1.0
        mesh = _frustum(part.size, taper, along_grain=along_grain)
    return mesh.transformed(part.position, part.orientation)


def concatenate(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one; vertices and faces keep their order and are numbered on."""
    vertex = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    face = np.cumsum([0, *(m.num_faces for m in meshes[:-1])])
    return Mesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        normals=np.concatenate([m.normals for m in meshes]),
        uvs=np.concatenate([m.uvs for m in meshes]),
        triangles=_numbered_on([m.triangles for m in meshes], vertex),
        faces=_numbered_on([m.faces for m in meshes], face),
    )


def _numbered_on(indices: list[Ints], starts: Ints) -> Ints:
    return np.concatenate([i + s for i, s in zip(indices, starts, strict=True)], dtype=np.int32)


# For each face of a box: its normal, and the directions of u and v seen from outside.
_FACES = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    ],
    dtype=np.float64,
)
_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_QUAD = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
_UNIT_BOX = (_FACES[:, None, 0] / 2 + np.einsum("cd,fdk->fck", _CORNERS, _FACES[:, 1:])).reshape(24, 3)
_BOX_NORMALS = np.repeat(_FACES[:, 0], 4, axis=0)
_BOX_TRIANGLES = np.concatenate([_QUAD + 4 * i for i in range(6)], dtype=np.int32)
_BOX_FACES = np.repeat(np.arange(6, dtype=np.int32), 4)


def _box(size: Vec3, offset: Floats, *, along_grain: bool) -> Mesh:
    extent = np.asarray(size)
    vertices = _UNIT_BOX * extent
    axes = _FACES[:, 1:]
    if along_grain:
        length = np.abs(axes) @ extent
        turned = np.stack([axes[:, 1], -axes[:, 0]], axis=1)
        axes = np.where((length[:, 1] > length[:, 0])[:, None, None], turned, axes)
    uvs = np.einsum("fck,fdk->fcd", (vertices + offset).reshape(6, 4, 3), axes)
    return Mesh(
        vertices=vertices,
        normals=_BOX_NORMALS,
        uvs=uvs.reshape(24, 2),
        triangles=_BOX_TRIANGLES,
        faces=_BOX_FACES,
    )


def _num_segments(radius: float) -> int:
    if radius <= MAX_CHORD_ERROR_M:
        return MIN_SEGMENTS
    exact = math.pi / math.acos(1 - MAX_CHORD_ERROR_M / radius)
    return min(max(math.ceil(exact), MIN_SEGMENTS), MAX_SEGMENTS)


def _circle(num: int) -> Floats:
    """``num`` + 1 points of the unit circle; the last is the first again, for the seam of the texture."""
    angle = np.linspace(0, 2 * math.pi, num + 1)
    angle[-1] = 0.0
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _grid_triangles(rows: int, columns: int) -> Ints:
    """Triangles of a grid of (rows + 1) x (columns + 1) vertices, row by row."""
    r, c = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (r * (columns + 1) + c).ravel()
    d = a + columns + 1
    return np.concatenate([np.stack([a, a + 1, d + 1], 1), np.stack([a, d + 1, d], 1)]).astype(np.int32)


@lru_cache(maxsize=4096)
def _frustum(size: Vec3, taper: float, *, along_grain: bool) -> Mesh:
    half, height = np.asarray(size[:2]) / 2, size[2]
    num = _num_segments(float(half.max()) * max(1.0, taper))
    ring = _circle(num)
    sides = []
    for scale, z in ((1.0, -height / 2), (taper, height / 2)):
        sides.append(np.column_stack([ring * half * scale, np.full(num + 1, z)]))
    slope = (1 - taper) * half.mean() / height
    normal = np.column_stack([ring / half * half.mean(), np.full(num + 1, slope)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    arc = np.linspace(0, 2 * math.pi * half.mean() * max(1.0, taper), num + 1)
    flat = np.concatenate([np.column_stack([arc, np.full(num + 1, z)]) for z in (0.0, height)])
    if along_grain and height > arc[-1]:
        flat = np.column_stack([flat[:, 1], -flat[:, 0]])
    side = Mesh(
        vertices=np.concatenate(sides),
        normals=np.tile(normal, (2, 1)),
        uvs=flat,
        triangles=_grid_triangles(1, num),
        faces=np.zeros(2 * num + 2, np.int32),
    )
    caps = [_cap(ring * half, -height / 2, up=False)]
    if taper > 0:
        caps.append(_cap(ring * half * taper, height / 2, up=True))
    return concatenate([side, *caps])


def _cap(ring: Floats, z: float, *, up: bool) -> Mesh:
    points = ring[:-1]
    num = len(points)
    fan = np.stack([np.zeros(num - 2), np.arange(1, num - 1), np.arange(2, num)], axis=1).astype(np.int32)
    return Mesh(
        vertices=np.column_stack([points, np.full(num, z)]),
        normals=np.tile([0.0, 0.0, 1.0 if up else -1.0], (num, 1)),
        uvs=points * ([1, 1] if up else [1, -1]),
        triangles=fan if up else fan[:, ::-1].copy(),
        faces=np.zeros(num, np.int32),
    )


@lru_cache(maxsize=4096)
def _hull(points: tuple[Vec3, ...]) -> Mesh:
    hull = ConvexHull(np.asarray(points))
    planes, face_of = np.unique(hull.equations, axis=0, return_inverse=True)
    order = np.argsort(face_of, kind="stable")
    corners, normals = hull.points[hull.simplices[order]], planes[face_of[order], :3]
    turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_inward = np.einsum("tk,tk->t", turn, normals) < 0
    corners[is_inward] = corners[is_inward, ::-1]
    is_level = np.abs(normals[:, 2]) > _UPRIGHT
    along_x = np.array((1.0, 0.0, 0.0)) - normals[:, :1] * normals
    right = np.where(is_level[:, None], along_x, np.cross((0.0, 0.0, 1.0), normals))
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(normals, right)], axis=1)
    return Mesh(
        vertices=corners.reshape(-1, 3),
        normals=np.repeat(normals, 3, axis=0),
        uvs=np.einsum("tck,tdk->tcd", corners, axes).reshape(-1, 2),
        triangles=np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
        faces=np.repeat(face_of[order], 3).astype(np.int32),
    )


@lru_cache(maxsize=4096)
def _ellipsoid(size: Vec3) -> Mesh:
    half = np.asarray(size) / 2
    columns = _num_segments(float(half.max()))
    rows = max(columns // 2, 4)
    ring = _circle(columns)
    polar = np.linspace(-math.pi / 2, math.pi / 2, rows + 1)
    unit = np.concatenate(
        [np.column_stack([ring * math.cos(p), np.full(columns + 1, math.sin(p))]) for p in polar]
    )
    normals = unit / half
    arc = np.linspace(0, 2 * math.pi * half[:2].mean(), columns + 1)
    uvs = np.concatenate(
        [np.column_stack([arc, np.full(columns + 1, (p + math.pi / 2) * half.mean())]) for p in polar]
    )
    return Mesh(
        vertices=unit * half,
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        uvs=uvs,
        triangles=_grid_triangles(rows, columns),
        faces=np.zeros(len(uvs), np.int32),
    )
