"""Triangles with materials of their own: what a catalogue's mesh is once it has been read.

Owns the data and what counts as sound. Reading, storing and thinning it stand elsewhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_TRIANGLES = 1_000_000
"""The heaviest of the 820 Debian models has 198,396."""
MAX_VERTICES = 3 * MAX_TRIANGLES
MAX_MATERIALS = 1_000
MAX_EXTENT = 1e6
"""Of any coordinate; no unit, as files are scaled to their stated size afterwards."""

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class Material:
    """How one group of triangles looks."""

    color: tuple[float, float, float]
    """Red, green, blue as shown on a screen, 0 to 1; not used where there is a texture."""
    opacity: float = 1.0
    """0 is clear, 1 is solid."""
    texture: bytes | None = None
    """A PNG of 8-bit colour, with an alpha channel where parts of it are cut out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TriangleMesh:
    """Triangles in groups of one material, counter-clockwise seen from outside."""

    vertices: Floats
    """(V, 3), metres, once the mesh has its size."""
    normals: Floats
    """(V, 3), unit length, outward."""
    uvs: Floats
    """(V, 2), in widths and heights of the texture, which repeats: u to the right, v upwards."""
    triangles: Ints
    """(T, 3), indices of vertices; groups follow each other."""
    sizes: tuple[int, ...]
    """How many triangles each group has, at least one."""
    materials: tuple[Material, ...]
    """One for each group."""

    def group_of_triangles(self) -> NDArray[np.intp]:
        """(T,), the group of every triangle."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    def part(self, is_wanted: NDArray[np.bool_]) -> "TriangleMesh":
        """The triangles that are marked in (T,), with their vertices and the groups that have any of them."""
        used, triangles = np.unique(self.triangles[is_wanted], return_inverse=True)
        groups, sizes = np.unique(self.group_of_triangles()[is_wanted], return_counts=True)
        return TriangleMesh(
            vertices=self.vertices[used],
            normals=self.normals[used],
            uvs=self.uvs[used],
            triangles=triangles.reshape(-1, 3).astype(np.int32),
            sizes=tuple(sizes.tolist()),
            materials=tuple(self.materials[i] for i in groups),
        )


def fault(mesh: TriangleMesh) -> str | None:
    """What is unsound about a mesh, as the end of a sentence, or None."""
    num_vertices, num_triangles = len(mesh.vertices), len(mesh.triangles)
    if not 0 < num_triangles <= MAX_TRIANGLES:
        return f"has {num_triangles} triangles; allowed: 1 to {MAX_TRIANGLES}"
    if num_vertices > MAX_VERTICES:
        return f"has {num_vertices} vertices; at most {MAX_VERTICES} are allowed"
    if not 0 < len(mesh.sizes) == len(mesh.materials) <= MAX_MATERIALS:
        return (
            f"has {len(mesh.sizes)} groups and {len(mesh.materials)} materials; allowed: 1 to {MAX_MATERIALS}"
        )
    if min(mesh.sizes) < 1 or sum(mesh.sizes) != num_triangles:
        return f"has groups of {sum(mesh.sizes)} triangles in all; there are {num_triangles}"
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= num_vertices:
        return f"names a vertex that is not one of its {num_vertices}"
    arrays = (mesh.vertices, mesh.normals, mesh.uvs)
    if not all(np.isfinite(a).all() and np.abs(a).max(initial=0) <= MAX_EXTENT for a in arrays):
        return f"has a coordinate that is no number within ±{MAX_EXTENT:g}"
    return None
