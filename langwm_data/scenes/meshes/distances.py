"""How far points are from segments and triangles, many at a time. NumPy only."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_TINY = np.finfo(float).tiny


def to_segments(points: Floats, start: Floats, end: Floats) -> Floats:
    """(N,): from each point (N, 3) to its own segment; a segment may be a point."""
    along, offset = end - start, points - start
    share = _dot(offset, along) / np.maximum(_dot(along, along), _TINY)
    return np.linalg.norm(offset - np.clip(share, 0, 1)[:, None] * along, axis=1)


def to_triangles(points: Floats, a: Floats, b: Floats, c: Floats) -> Floats:
    """(N,): from each point (N, 3) to its own triangle; a triangle may be a segment."""
    normal = np.cross(b - a, c - a)
    squared = np.maximum(_dot(normal, normal), _TINY)
    offset = points - a
    height = np.abs(_dot(offset, normal)) / np.sqrt(squared)
    toward_c = _dot(np.cross(b - a, offset), normal) / squared
    toward_b = _dot(np.cross(offset, c - a), normal) / squared
    is_above = (toward_b >= 0) & (toward_c >= 0) & (toward_b + toward_c <= 1) & (squared > _TINY)
    rim = np.minimum(to_segments(points, a, b), to_segments(points, b, c))
    return np.where(is_above, height, np.minimum(rim, to_segments(points, c, a)))


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("nk,nk->n", a, b)
