"""Polygons in space cut into triangles of their own corners. NumPy only."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

MAX_CORNERS = 1_024
"""Of one polygon; the Debian catalogues reach 272."""
MAX_CLIPPING_STEPS = 4_000_000
"""Sum of squared corners over the polygons of a file that are not convex: about half a minute."""

_FLAT = 1e-9
"""Turns the wrong way by less than this, relative to the polygon's area, are rounding."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def triangulate(points: Floats, lengths: Ints) -> tuple[Ints, Ints]:
    """Triangles (T, 3) as numbers of corners, and (T,) the polygon that each belongs to, ascending.

    A convex polygon becomes a fan; of another one ears are clipped, so that dents stay dents. Polygons of
    fewer than three corners vanish.

    Args:
        points: (C, 3), the corners of all polygons, one polygon after another.
        lengths: (P,), how many corners each polygon has.

    Raises:
        ValueError: If a polygon has too many corners or all of them together would take too long; the
            message is the end of a sentence.
    """
    if lengths.max(initial=0) > MAX_CORNERS:
        raise ValueError(f"has a polygon of {lengths.max()} corners; at most {MAX_CORNERS} are read")
    starts = np.cumsum(lengths) - lengths
    triangles, owners = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    steps = 0
    for length in np.unique(lengths[lengths >= 3]).tolist():
        polygons = np.flatnonzero(lengths == length)
        corners = starts[polygons, None] + np.arange(length)
        is_convex, normals = _convexity(points[corners])
        triangles.append(_fans(corners[is_convex]))
        owners.append(np.repeat(polygons[is_convex], length - 2))
        dented = np.flatnonzero(~is_convex)
        steps += len(dented) * length**2
        if steps > MAX_CLIPPING_STEPS:
            raise ValueError(
                f"has polygons that are too dented; at most {MAX_CLIPPING_STEPS} steps are taken"
            )
        for i in dented.tolist():
            ears = np.array(list(_ears(_flattened(points[corners[i]], normals[i]))))
            triangles.append(corners[i][ears])
            owners.append(np.repeat(polygons[i], length - 2))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def _fans(corners: Ints) -> Ints:
    length = corners.shape[1]
    fan = np.stack([np.zeros(length - 2, int), np.arange(1, length - 1), np.arange(2, length)], axis=1)
    return corners[:, fan].reshape(-1, 3)


def _convexity(polygons: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Whether each of (P, n, 3) turns one way only, and its normal (P, 3), twice its area long."""
    around = polygons - polygons[:, :1]
    following = np.roll(around, -1, axis=1)
    normals = np.cross(around, following).sum(axis=1)  # Newell's
    if polygons.shape[1] == 3:
        return np.ones(len(polygons), bool), normals
    edges = following - around
    turns = np.einsum("pnk,pk->pn", np.cross(np.roll(edges, 1, axis=1), edges), normals)
    return (turns >= -_FLAT * (normals**2).sum(axis=1)[:, None]).all(axis=1), normals


def _flattened(polygon: Floats, normal: Floats) -> Floats:
    """(n, 2): the polygon seen along the axis nearest to its normal, counter-clockwise."""
    axis = int(np.abs(normal).argmax())
    flat = polygon[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] > 0 else flat * [1, -1]


def _ears(points: Floats) -> Iterator[tuple[int, int, int]]:
    """Triangles of a counter-clockwise polygon: convex corners that hold no other corner, cut off in turn."""
    left = list(range(len(points)))
    at = 0
    num_failures = 0
    while len(left) > 3:
        at %= len(left)
        before, tip, after = left[at - 1], left[at], left[(at + 1) % len(left)]
        # A polygon that crosses itself may have no ear; then any corner goes.
        if num_failures > len(left) or _is_ear(points, before, tip, after, left):
            yield before, tip, after
            del left[at]
            num_failures = 0
        else:
            num_failures += 1
            at += 1
    yield left[0], left[1], left[2]


def _is_ear(points: Floats, before: int, tip: int, after: int, left: list[int]) -> bool:
    a, b, c = points[before], points[tip], points[after]
    if _turn(a, b, c[None])[0] <= 0:
        return False
    rest = points[left]
    inside = (_turn(a, b, rest) >= 0) & (_turn(b, c, rest) >= 0) & (_turn(c, a, rest) >= 0)
    is_own = np.zeros(len(rest), bool)
    for corner in (a, b, c):
        is_own |= (rest == corner).all(axis=1)
    return not (inside & ~is_own).any()


def _turn(a: Floats, b: Floats, points: Floats) -> Floats:
    """Positive for the points left of the line from a to b."""
    return (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0])
