"""A mesh cut into small pieces, so that it can be counted in the cells of a grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.meshes.triangles import TriangleMesh

_MAX_ROUNDS = 40
"""Halving the longest edge so often makes a millionth of any edge."""

CELLS_ALONG = 40
"""Cells of a grid along the longest side of a mesh, within the limits below."""
MIN_CELL_M, MAX_CELL_M = 0.004, 0.04
_PIECES_PER_CELL = 0.7
"""Longest edge of a piece in cells: short enough that a level sheet leaves no cell out."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Small triangles that make up a mesh."""

    cell_m: float
    """Edge of the cells that they are small enough for."""
    corners: Floats
    """(P, 3, 3), metres."""
    uvs: Floats
    """(P, 2), at their middles."""
    areas: Floats
    """(P,), square metres."""
    groups: Ints
    """(P,), material."""


def cut(mesh: TriangleMesh) -> Pieces:
    """Halve edges until all are shorter than a cell; the surface stays where it is."""
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    cell_m = min(max(extent / CELLS_ALONG, MIN_CELL_M), MAX_CELL_M)
    max_edge_m = _PIECES_PER_CELL * cell_m
    points = np.concatenate([mesh.vertices, mesh.uvs], axis=1).astype(np.float64)
    open_corners = points[mesh.triangles]
    open_groups = mesh.group_of_triangles().astype(np.int64)
    done_corners, done_groups = [], []
    for _ in range(_MAX_ROUNDS):
        ahead = np.roll(open_corners, -1, axis=1)
        lengths = np.linalg.norm((ahead - open_corners)[..., :3], axis=2)
        is_long = lengths.max(axis=1, initial=0) > max_edge_m
        done_corners.append(open_corners[~is_long])
        done_groups.append(open_groups[~is_long])
        open_corners = halved(open_corners[is_long], lengths[is_long].argmax(axis=1))
        open_groups = np.repeat(open_groups[is_long], 2)
        if not len(open_corners):
            break
    corners = np.concatenate([*done_corners, open_corners])
    xyz = corners[..., :3]
    normals = np.cross(xyz[:, 1] - xyz[:, 0], xyz[:, 2] - xyz[:, 0])
    return Pieces(
        cell_m=cell_m,
        corners=xyz,
        uvs=corners[..., 3:].mean(axis=1),
        areas=np.linalg.norm(normals, axis=1) / 2,
        groups=np.concatenate([*done_groups, open_groups]),
    )


def halved(corners: Floats, edge: Ints) -> Floats:
    """(2 N, 3, C): each triangle cut in two at the middle of one of its edges."""
    turned = np.take_along_axis(corners, (edge[:, None, None] + np.arange(3)[:, None]) % 3, axis=1)
    first, second, third = turned[:, 0], turned[:, 1], turned[:, 2]
    middle = (first + second) / 2
    halves = np.stack(
        [np.stack([first, middle, third], axis=1), np.stack([middle, second, third], axis=1)], axis=1
    )
    return halves.reshape(-1, 3, corners.shape[2])
