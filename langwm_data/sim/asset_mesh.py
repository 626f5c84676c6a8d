"""From meshes of others to triangles that the renderers draw: faces, and texture coordinates in metres.

Owns what a renderer must know of such a mesh beyond its triangles. Sheets, and whatever has its inside out,
are drawn from both sides, as their makers are not of one mind about which side is outside.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from langwm_data.scenes.meshes.triangles import Material, TriangleMesh
from langwm_data.sim.mesh import Floats, Ints, Mesh

_FLAT_TILE_M = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class AssetMesh:
    """A mesh in the frame of its owner. A face is a piece without a crease or a seam, of one material."""

    mesh: Mesh
    face_group: Ints
    """(F,), the group of triangles, and so the material, of each face."""
    face_tile_m: Floats
    """(F,), metres that the width of a face's texture covers on average."""
    is_two_sided: NDArray[np.bool_]
    """(T,), whether a triangle may be seen from behind; those of closed bodies cannot be."""
    materials: tuple[Material, ...]
    """Of each group."""


@lru_cache(maxsize=1024)
def asset_mesh(source: TriangleMesh) -> AssetMesh:
    """What the renderers draw of ``source``."""
    group = source.group_of_triangles()
    triangles, owner = _one_group_a_vertex(source.triangles, group, len(source.vertices))
    faces = _smooth_pieces(triangles, len(owner))
    order = np.argsort(faces, kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    owner, faces, triangles = owner[order], faces[order].astype(np.int32), rank[triangles]
    vertices, uvs = source.vertices[owner].astype(np.float64), source.uvs[owner].astype(np.float64)
    first = np.unique(faces[triangles[:, 0]], return_index=True)[1]
    tile_m = _tile_sizes(vertices, uvs, triangles, faces)
    return AssetMesh(
        mesh=Mesh(
            vertices=vertices,
            normals=source.normals[owner].astype(np.float64),
            uvs=uvs * tile_m[faces][:, None],
            triangles=triangles,
            faces=faces,
        ),
        face_group=group[first].astype(np.int32),
        face_tile_m=tile_m,
        is_two_sided=~_closed(vertices, triangles),
        materials=source.materials,
    )


def _one_group_a_vertex(
    triangles: Ints, group: NDArray[np.intp], num_vertices: int
) -> tuple[Ints, NDArray[np.intp]]:
    """Triangles whose vertices belong to one group each, and the old vertex of every new one."""
    key = triangles + group[:, None] * num_vertices
    used, inverse = np.unique(key, return_inverse=True)
    return inverse.reshape(-1, 3).astype(np.int32), used % num_vertices


def _smooth_pieces(triangles: Ints, num_vertices: int) -> NDArray[np.int32]:
    """(V,), from 0: the connected piece of every vertex; vertices are parted at creases and seams."""
    start, end = triangles.ravel(), np.roll(triangles, 1, axis=1).ravel()
    links = coo_matrix((np.ones(len(start), np.int8), (start, end)), shape=(num_vertices, num_vertices))
    return connected_components(links, directed=False)[1]


def _closed(vertices: Floats, triangles: Ints) -> NDArray[np.bool_]:
    """(T,), whether a triangle belongs to a body without holes whose outside is its outside.

    Along each edge of such a body as many triangles go one way as the other, and its volume is positive.
    """
    points, same = np.unique(vertices, axis=0, return_inverse=True)
    corners = same.reshape(-1)[triangles]
    start, end = corners, np.roll(corners, -1, axis=1)
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    _, edge = np.unique(key, return_inverse=True)
    edge = edge.reshape(-1, 3)
    num_edges = int(edge.max()) + 1
    owner = np.repeat(np.arange(len(triangles)), 3)
    links = coo_matrix(
        (np.ones(edge.size, np.int8), (owner, len(triangles) + edge.ravel())),
        shape=(len(triangles) + num_edges,) * 2,
    )
    body = connected_components(links, directed=False)[1][: len(triangles)]
    balance = np.bincount(edge.ravel(), np.where(start < end, 1, -1).ravel(), num_edges)
    is_open = np.zeros(int(body.max()) + 1, np.bool_)
    is_open[np.repeat(body, 3)[balance[edge.ravel()] != 0]] = True
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    volume = np.bincount(body, np.einsum("tk,tk->t", a, np.cross(b, c)))
    return (~is_open & (volume > 0))[body]


def _tile_sizes(vertices: Floats, uvs: Floats, triangles: Ints, faces: Ints) -> Floats:
    """(F,), the square root of area on the surface to area on the texture; one metre where there is none."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    (a_u, a_v), (b_u, b_v), (c_u, c_v) = np.moveaxis(uvs[triangles], (1, 2), (0, 1))
    covered = np.abs((b_u - a_u) * (c_v - a_v) - (b_v - a_v) * (c_u - a_u))
    face = faces[triangles[:, 0]]
    areas, covers = np.bincount(face, area), np.bincount(face, covered)
    is_covered = (covers > 1e-12) & (areas > 0)
    return np.sqrt(np.where(is_covered, areas, _FLAT_TILE_M) / np.where(is_covered, covers, 1.0))
