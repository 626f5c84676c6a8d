"""Moves, sight and spreading on a grid of free and blocked cells: pure functions of arrays.

Lengths are in cells, a cell (i, j) covers [i, i + 1] x [j, j + 1], and its middle is at + 0.5.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_array

Mask = NDArray[np.bool_]
Ints = NDArray[np.intp]
Floats = NDArray[np.float64]
Move = tuple[int, int]

_MOVES: tuple[Move, ...] = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))
"""Half of the sixteen moves; the others are these backwards."""

_AROUND: tuple[Move, ...] = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
_RAY_BLOCK = 32

_Kind = TypeVar("_Kind", bound=np.generic)


def largest_component(free: Mask) -> Mask:
    """The largest part of the free cells that hangs together by edges."""
    labels: NDArray[np.int32] = ndimage.label(free)[0]  # pyright: ignore
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return free & np.equal(labels, int(sizes.argmax()))


def move_graph(free: Mask) -> csr_array:
    """Lengths of moves between free cells, numbered in the order of ``argwhere``.

    A move is there only if the cells that it touches on its way are free too.
    """
    number = np.full(free.shape, -1)
    number[free] = np.arange(free.sum())
    rows, columns, lengths = [], [], []
    for move in _MOVES:
        start, end = _at(number, move, (0, 0)), _at(number, move, move)
        is_open = (start >= 0) & (end >= 0)
        for between in _between(move):
            is_open &= _at(number, move, between) >= 0
        rows += [start[is_open], end[is_open]]
        columns += [end[is_open], start[is_open]]
        lengths.append(np.full(2 * int(is_open.sum()), np.hypot(*move)))
    entries = (np.concatenate(rows), np.concatenate(columns))
    num = int(free.sum())
    return csr_array((np.concatenate(lengths), entries), shape=(num, num))


def with_source(graph: csr_array, cells: Ints, lengths: Floats) -> csr_array:
    """The graph with one more node, the last, from which moves lead to some cells."""
    num = len(graph.indptr)
    indptr = np.append(graph.indptr, graph.indptr[-1] + len(cells))
    data = np.concatenate([graph.data, lengths])
    return csr_array((data, np.concatenate([graph.indices, cells]), indptr), shape=(num, num))


def in_sight(free: Mask, at: Floats) -> Mask:
    """Free cells whose middle is seen from the point ``at`` along free cells alone.

    A fan of rays, close enough to each other that none misses a cell, is followed to the first
    blocked cell; a cell is seen when the rays on both sides of it get as far.
    """
    reach = float(np.hypot(*free.shape)) + 2
    num_rays = int(np.ceil(2 * np.pi * reach))
    angles = np.arange(num_rays + 1) * (2 * np.pi / num_rays)
    clear = _first_blocked(free, at, np.stack([np.cos(angles), np.sin(angles)]), np.arange(0, reach, 0.3))
    cells = np.argwhere(free)
    offset = cells + 0.5 - at
    turn = np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi) * (num_rays / (2 * np.pi))
    ray = np.minimum(turn.astype(int), num_rays - 1)
    seen = np.zeros(free.shape, bool)
    seen[tuple(cells.T)] = np.hypot(offset[:, 0], offset[:, 1]) <= np.minimum(clear[ray], clear[ray + 1])
    return seen


def _first_blocked(free: Mask, at: Floats, directions: Floats, radii: Floats) -> Floats:
    """For each ray from ``at``, the first of ``radii`` (ascending, from 0) that lies in a blocked cell.

    Rays are followed a few cells at a time, as most end long before the far side of the grid.
    """
    is_blocked = ~np.pad(free, 1)
    clear = np.full(directions.shape[1], radii[-1])
    going = np.arange(directions.shape[1])
    for start in range(0, len(radii), _RAY_BLOCK):
        some = radii[start : start + _RAY_BLOCK]
        points = at[:, None, None] + directions[:, going, None] * some
        i, j = (
            np.clip(np.floor(p).astype(int) + 1, 0, n + 1) for p, n in zip(points, free.shape, strict=True)
        )
        hits = is_blocked[i, j]
        has_ended = hits.any(axis=1)
        clear[going[has_ended]] = some[hits[has_ended].argmax(axis=1)]
        going = going[~has_ended]
        if not len(going):
            break
    return clear


def spread(values: Floats, into: Mask) -> Floats:
    """Finite values carried on, cell by cell, into the infinite cells of a mask."""
    padded = np.pad(values, 1, constant_values=np.inf)
    row = padded.shape[1]
    steps = np.array([di * row + dj for di, dj in _AROUND])
    lengths = np.hypot(*np.transpose(_AROUND))
    flat = padded.ravel()
    i, j = np.nonzero(np.isinf(values) & into)
    cells = (i + 1) * row + j + 1
    while len(cells):
        best = (flat[cells[:, None] + steps] + lengths).min(axis=1)
        is_reached = np.isfinite(best)
        if not is_reached.any():
            break
        flat[cells[is_reached]] = best[is_reached]
        cells = cells[~is_reached]
    return padded[1:-1, 1:-1]


def spread_once(values: Floats) -> Floats:
    """Finite values carried into all cells beside them."""
    return np.where(np.isinf(values), _best_neighbour(values), values)


def _best_neighbour(values: Floats) -> Floats:
    padded = np.pad(values, 1, constant_values=np.inf)
    best = np.full_like(values, np.inf)
    for di, dj in _AROUND:
        there = padded[1 + di : padded.shape[0] - 1 + di, 1 + dj : padded.shape[1] - 1 + dj]
        best = np.minimum(best, there + np.hypot(di, dj))
    return best


def _between(move: Move) -> tuple[Move, ...]:
    """Cells that a move passes through or squeezes by."""
    a, b = move
    if abs(a) + abs(b) == 1:
        return ()
    if abs(a) == abs(b):
        return ((a, 0), (0, b))
    return ((a // 2, 0), (a // 2, b)) if abs(a) == 2 else ((0, b // abs(b)), (a, b // abs(b)))


def _at(grid: NDArray[_Kind], move: Move, offset: Move) -> NDArray[_Kind]:
    """What lies ``offset`` from every cell from which ``move`` stays on the grid."""
    slices = []
    for size, m, o in zip(grid.shape, move, offset, strict=True):
        low, high = max(0, -m), size - max(0, m)
        slices.append(slice(low + o, high + o))
    return grid[tuple(slices)]
