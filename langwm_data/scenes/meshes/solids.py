"""A few boxes that hug a mesh: what it collides with.

The mesh is counted in the cells of a grid, each with the box around what lies in it; cells that the mesh
surrounds count as full. All of it together begins as one box, and of all boxes the one is cut next that
loses the most empty space. A cut makes two parts along an axis, or three, as a table loses nothing before
both pairs of its legs are cut off. So every point of the mesh is in a box, nothing sticks
out of the box around the mesh, and what the boxes hold too much is the price of their small number.

Source: ours (ADR-0010).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.meshes.pieces import Pieces

MAX_SOLIDS = 16
MIN_GAIN_M3 = 0.0003
"""A cut that saves less space is not made: a cube of 7 cm."""
MIN_GAIN_SHARE = 0.003
"""The same as a share of the box around the mesh."""
MIN_THICKNESS_M = 0.004
"""No solid is thinner, as physics loses what is."""
ABOVE_TOP_M = 0.003
"""What is higher than a top by more is kept apart from what is below it."""
_SURROUNDED = 5
"""A cell is full when the mesh lies on so many of its six sides: all but an open bottom or front."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Cells of the grid that hold something."""

    index: Ints
    """(N, 3)."""
    low: Floats
    """(N, 3), lowest corner of what is in each."""
    high: Floats

    def __getitem__(self, which: NDArray[np.bool_] | Ints) -> "_Cells":
        return _Cells(index=self.index[which], low=self.low[which], high=self.high[which])


@dataclass(frozen=True, kw_only=True)
class _Cut:
    gain: float
    """How much smaller the boxes become, cubic metres for each box that there are more."""
    axis: int
    firsts: tuple[int, ...]
    """One index or two: cells from there on go to the next part."""


def hugging_boxes(pieces: Pieces, top_m: float | None = None) -> Floats:
    """(N, 2, 3): lowest and highest corners of at most ``MAX_SOLIDS`` boxes that hold a mesh.

    Args:
        pieces: Of the mesh.
        top_m: A height on which things are put: no box holds both what is below and what is above it.
    """
    low, high = pieces.corners.min(axis=(0, 1)), pieces.corners.max(axis=(0, 1))
    parts = _at_top(_cells(pieces, low, high), top_m)
    least = max(MIN_GAIN_M3, MIN_GAIN_SHARE * float(np.prod(high - low)))
    work = [(cells, _best_cut(cells)) for cells in parts]
    while len(work) < MAX_SOLIDS - 1:
        number = max(range(len(work)), key=lambda i: work[i][1].gain)
        cells, cut = work[number]
        if cut.gain < least:
            break
        which = np.searchsorted(cut.firsts, cells.index[:, cut.axis], side="right")
        parts = [cells[which == i] for i in range(len(cut.firsts) + 1)]
        work[number : number + 1] = [(part, _best_cut(part)) for part in parts]
    boxes = np.array([[cells.low.min(axis=0), cells.high.max(axis=0)] for cells, _ in work])
    return _thick(boxes, low, high)


def _cells(pieces: Pieces, low: Floats, high: Floats) -> _Cells:
    """What lies in each cell of the grid, and the cells that are surrounded by it."""
    cell_m = pieces.cell_m
    shape = np.maximum(np.ceil((high - low) / cell_m - 1e-6), 1).astype(np.int64)
    index = np.clip(((pieces.corners.mean(axis=1) - low) / cell_m).astype(np.int64), 0, shape - 1)
    flat = np.asarray(np.ravel_multi_index(tuple(index.T), tuple(shape)))
    order = np.argsort(flat, kind="stable")
    used, starts = np.unique(flat[order], return_index=True)
    is_used = np.zeros(tuple(shape), bool)
    is_used.ravel()[used] = True
    full = np.argwhere(_surrounded(is_used))
    return _Cells(
        index=np.concatenate([np.stack(np.unravel_index(used, tuple(shape)), axis=1), full]),
        low=np.concatenate(
            [np.minimum.reduceat(pieces.corners.min(axis=1)[order], starts), low + full * cell_m]
        ),
        high=np.concatenate(
            [
                np.maximum.reduceat(pieces.corners.max(axis=1)[order], starts),
                np.minimum(low + (full + 1) * cell_m, high),
            ]
        ),
    )


def _surrounded(is_used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    sides = np.zeros(is_used.shape, np.int8)
    for axis in range(3):
        sides += np.logical_or.accumulate(is_used, axis=axis)
        sides += np.flip(np.logical_or.accumulate(np.flip(is_used, axis), axis=axis), axis)
    return (sides >= _SURROUNDED) & ~is_used


def _at_top(cells: _Cells, top_m: float | None) -> list[_Cells]:
    """The cells below a height and those above it; a cell that reaches across is cut there."""
    if top_m is None:
        return [cells]
    limit = top_m + ABOVE_TOP_M
    below, above = cells[cells.low[:, 2] <= limit], cells[cells.high[:, 2] > limit]
    np.minimum(below.high[:, 2], limit, out=below.high[:, 2])
    np.maximum(above.low[:, 2], limit, out=above.low[:, 2])
    return [part for part in (below, above) if len(part.index)]


def _best_cut(cells: _Cells) -> _Cut:
    """The cut into two or three parts along an axis that saves most."""
    best = _Cut(gain=0.0, axis=0, firsts=(0,))
    whole = float(_volume(cells.low.min(axis=0), cells.high.max(axis=0)))
    for axis in range(3):
        order = np.argsort(cells.index[:, axis], kind="stable")
        index, starts = np.unique(cells.index[order, axis], return_index=True)
        # From here on a slice of cells counts as one.
        low = np.minimum.reduceat(cells.low[order], starts)
        high = np.maximum.reduceat(cells.high[order], starts)
        lower = _volume(np.minimum.accumulate(low), np.maximum.accumulate(high))[:-1]
        upper = _volume(np.minimum.accumulate(low[::-1]), np.maximum.accumulate(high[::-1]))[-2::-1]
        for i in range(len(index) - 1):
            middle = _volume(np.minimum.accumulate(low[i + 1 :]), np.maximum.accumulate(high[i + 1 :]))[:-1]
            in_two = whole - lower[i] - upper[i]
            in_three = (whole - lower[i] - middle - upper[i + 1 :]) / 2
            if in_two > best.gain:
                best = _Cut(gain=float(in_two), axis=axis, firsts=(int(index[i + 1]),))
            if in_three.max(initial=0.0) > best.gain:
                j = i + 1 + int(in_three.argmax())
                best = _Cut(
                    gain=float(in_three.max()), axis=axis, firsts=(int(index[i + 1]), int(index[j + 1]))
                )
    return best


def _volume(low: Floats, high: Floats) -> Floats:
    return np.prod(np.maximum(high - low, MIN_THICKNESS_M), axis=-1)


def _thick(boxes: Floats, low: Floats, high: Floats) -> Floats:
    """The boxes with none too thin, grown inwards where the mesh ends; a mesh that is a sheet stays one."""
    middle = boxes.mean(axis=1)
    half = np.maximum(boxes[:, 1] - boxes[:, 0], MIN_THICKNESS_M) / 2
    first = np.minimum(np.maximum(middle - half, low), high - 2 * half)
    return np.stack([np.maximum(first, low), np.minimum(first + 2 * half, high)], axis=1)
