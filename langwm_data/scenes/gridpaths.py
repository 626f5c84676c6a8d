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
    radii = np.arange(0, reach, 0.3)
    points = at[:, None, None] + np.stack([np.cos(angles), np.sin(angles)])[..., None] * radii
    i, j = (np.clip(np.floor(p).astype(int) + 1, 0, n + 1) for p, n in zip(points, free.shape, strict=True))
    is_blocked = ~np.pad(free, 1)[i, j]
    clear = radii[is_blocked.argmax(axis=1)]
    cells = np.argwhere(free)
    offset = cells + 0.5 - at
    turn = np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi) * (num_rays / (2 * np.pi))
    ray = np.minimum(turn.astype(int), num_rays - 1)
    seen = np.zeros(free.shape, bool)
    seen[tuple(cells.T)] = np.hypot(offset[:, 0], offset[:, 1]) <= np.minimum(clear[ray], clear[ray + 1])
    return seen


def spread(values: Floats, into: Mask) -> Floats:
    """Finite values carried on, cell by cell, into the infinite cells of a mask."""
    while True:
        wider = np.where(np.isinf(values) & into, _best_neighbour(values), values)
        if np.array_equal(wider, values):
            return values
        values = wider


def spread_once(values: Floats) -> Floats:
    """Finite values carried into all cells beside them."""
    return np.where(np.isinf(values), _best_neighbour(values), values)


def _best_neighbour(values: Floats) -> Floats:
    padded = np.pad(values, 1, constant_values=np.inf)
    best = np.full_like(values, np.inf)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
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
