"""Where small things can be put on a mesh: its largest level rectangle that is open upwards."""

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.meshes.pieces import Pieces

LEVEL_M = 0.004
"""How far from its height a surface may be and still count as level."""
_NUM_LEVELS = 4
"""Heights that are tried, those that cover most first."""

Floats = NDArray[np.float64]
Top = tuple[float, float, float, float, float]
"""Height, and x0, y0, x1, y1, metres in the frame of the mesh."""


def level_top(pieces: Pieces) -> Top | None:
    """The largest rectangle seen from above that is level, or None where nothing is."""
    low, high = pieces.corners.min(axis=(0, 1))[:2], pieces.corners.max(axis=(0, 1))[:2]
    heights = _heights(pieces, low)
    best, best_area = None, 0
    for level in _levels(heights):
        rows, columns, area = _largest_rectangle(np.abs(heights - level) <= LEVEL_M)
        if area > best_area:
            height = float(heights[rows, columns].max())
            x0, y0 = low + np.array([rows.start, columns.start]) * pieces.cell_m
            x1, y1 = np.minimum(low + np.array([rows.stop, columns.stop]) * pieces.cell_m, high)
            best, best_area = (height, float(x0), float(y0), float(x1), float(y1)), area
    return best


def _heights(pieces: Pieces, low: Floats) -> Floats:
    """(X, Y): the highest point above each cell, -inf where there is nothing."""
    middles = pieces.corners.mean(axis=1)
    cells = ((middles[:, :2] - low) / pieces.cell_m).astype(np.int64)
    heights = np.full(tuple(cells.max(axis=0) + 1), -np.inf)
    np.maximum.at(heights, (cells[:, 0], cells[:, 1]), middles[:, 2])
    return heights


def _levels(heights: Floats) -> list[float]:
    """The heights at which most cells are."""
    values = heights[np.isfinite(heights)]
    bins, counts = np.unique(np.round(values / LEVEL_M).astype(np.int64), return_counts=True)
    order = np.lexsort((bins, -counts))[:_NUM_LEVELS]
    return [float(np.median(values[np.round(values / LEVEL_M) == bins[i]])) for i in order]


def _largest_rectangle(mask: NDArray[np.bool_]) -> tuple[slice, slice, int]:
    """The largest all-true rectangle of a mask: rows, columns, number of cells."""
    best = slice(0, 0), slice(0, 0), 0
    run = np.zeros(mask.shape[1], np.int64)
    for row, is_true in enumerate(mask):
        run = np.where(is_true, run + 1, 0)
        stack: list[tuple[int, int]] = []
        for column, height in enumerate([*run.tolist(), 0]):
            start = column
            while stack and stack[-1][1] >= height:
                start, lower = stack.pop()
                area = lower * (column - start)
                if area > best[2]:
                    best = slice(row + 1 - lower, row + 1), slice(start, column), area
            stack.append((start, height))
    return best
