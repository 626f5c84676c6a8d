"""Triangles of walls and ceilings parted between rooms: those that reach into several are split first.

A triangle is halved across its longest edge until all of it is in one room, or it is no longer than a wall is
thick; as borders of rooms lie within walls, hardly one of them shows.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.igibson.meshes import Floats, Piece, cut
from langwm_data.scenes.meshes.pieces import halved
from langwm_data.scenes.meshes.triangles import MAX_TRIANGLES

MIN_EDGE_M = 0.1
MAX_EDGE_M = 3.0
"""Longer triangles are halved in any case: what lies within them could be missed by the points looked at."""
MOST_TRIANGLES = MAX_TRIANGLES // 4
"""No more are halved after as many have been looked at: then some borders of rooms are rough."""
BEFORE_M = 0.1
"""Where a point of a surface is, is asked this far before it."""

Ints = NDArray[np.integer]

_WEIGHTS = np.array(
    [
        *np.eye(3),
        *((1 - np.eye(3)) / 2),
        (1 / 3, 1 / 3, 1 / 3),
    ]
)
"""Corners, middles of edges and middle of a triangle."""


def part_by_room(piece: Piece, rooms_at: Callable[[Floats], Ints]) -> dict[int, Piece]:
    """The triangles of a piece by room.

    Args:
        piece: In world coordinates.
        rooms_at: Numbers of the rooms at points (N, 2).
    """
    mesh = piece.mesh
    columns = np.concatenate([mesh.vertices, mesh.normals, mesh.uvs], axis=1).astype(np.float64)
    group = mesh.group_of_triangles()
    done: list[tuple[Floats, Ints, Ints]] = []
    corners, num_triangles = columns[mesh.triangles], 0
    while len(corners):
        rooms = _rooms(corners, rooms_at)
        edges = _edges(corners)
        longest = edges.max(axis=1)
        is_mixed = (rooms != rooms[:, :1]).any(axis=1)
        num_triangles += len(corners)
        goes_on = (longest > MAX_EDGE_M) | (is_mixed & (longest > MIN_EDGE_M))
        goes_on &= num_triangles < MOST_TRIANGLES
        done.append((corners[~goes_on], group[~goes_on], rooms[~goes_on, -1]))
        corners = halved(corners[goes_on], edges[goes_on].argmax(axis=1))
        group = np.repeat(group[goes_on], 2)
    corners, group, owner = (np.concatenate(arrays) for arrays in zip(*done, strict=True))
    order = np.argsort(group, kind="stable")
    return cut(_assembled(piece, corners[order], group[order]), owner[order])


def _rooms(corners: Floats, rooms_at: Callable[[Floats], Ints]) -> Ints:
    """(T, 7): the room at each of the points looked at, the middle last."""
    a, b, c = np.moveaxis(corners[..., :3], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    points = np.einsum("pk,tkx->tpx", _WEIGHTS, corners[..., :2]) + BEFORE_M * normal[:, None, :2]
    return rooms_at(points.reshape(-1, 2)).reshape(len(corners), len(_WEIGHTS))


def _edges(corners: Floats) -> Floats:
    """(T, 3): the length of the edge from each corner to the next."""
    return np.linalg.norm(np.roll(corners, -1, axis=1)[..., :3] - corners[..., :3], axis=2)


def _assembled(piece: Piece, corners: Floats, group: Ints) -> Piece:
    """Corners that are the same become one vertex again."""
    keys = np.concatenate([corners.reshape(-1, corners.shape[2]), np.repeat(group, 3)[:, None]], axis=1)
    rows, index = np.unique(keys.astype(np.float32), axis=0, return_inverse=True)
    mesh = replace(
        piece.mesh,
        vertices=rows[:, :3],
        normals=rows[:, 3:6],
        uvs=rows[:, 6:8],
        triangles=index.reshape(-1, 3).astype(np.int32),
        sizes=tuple(np.bincount(group).tolist()),
    )
    return replace(piece, mesh=mesh)
