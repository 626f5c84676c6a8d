"""Normals for meshes that come without: smooth where faces meet at a small angle, sharp elsewhere.

Source: ours. Two thirds of the catalogues' files state no normals; their smoothing groups were mostly
lost when they were cleaned, so the angle decides.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

CREASE_RAD = math.radians(40)
"""Faces that meet at a larger angle have an edge between them: a rod of ten sides looks round."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def welded(vertices: Floats) -> Ints:
    """(V,): equal numbers for vertices at exactly the same place, in the order of the places."""
    order = np.lexsort(vertices.T[::-1])
    is_new = (vertices[order][1:] != vertices[order][:-1]).any(axis=1)
    places = np.empty(len(vertices), np.int64)
    places[order] = np.cumsum(np.concatenate([[0], is_new]))[: len(order)]
    return places


def face_vectors(vertices: Floats, triangles: Ints) -> Floats:
    """(T, 3): normals of the triangles, twice their area long."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    return np.cross(b - a, c - a)


def smooth_normals(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Unit normals (F, 3) and for each corner (T, 3) which of them is its own.

    Corners share a normal where their triangles meet at a place, linked by edges that are not creases.
    The normal is the mean over these triangles, weighted by their angles there, so that it does not depend
    on how polygons were cut, and by their areas, so that large flat faces stay flat beside small bevels.

    Args:
        vertices: (V, 3), any unit; triangles need not share them.
        triangles: (T, 3), none without area.
    """
    places = welded(vertices)[triangles]
    vectors = face_vectors(vertices, triangles)
    units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    first, second = _meeting_corners(places, units)
    num_corners = triangles.size
    links = coo_matrix((np.ones(len(first), bool), (first, second)), shape=(num_corners, num_corners))
    fan = connected_components(links, directed=False)[1].reshape(-1, 3).astype(np.int64)
    return mean_normals(vertices, triangles, fan), fan


def mean_normals(vertices: Floats, triangles: Ints, fan: Ints) -> Floats:
    """(F, 3): the unit normal of each number in ``fan`` (T, 3), which says what corners share one."""
    weighted = face_vectors(vertices, triangles)[:, None] * _angles(vertices[triangles])[..., None]
    sums = np.zeros((fan.max() + 1, 3))
    np.add.at(sums, fan.ravel(), weighted.reshape(-1, 3))
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return sums / np.where(lengths > 0, lengths, 1)


def _angles(corners: Floats) -> Floats:
    """(T, 3), radians: the angle of each of the corners (T, 3, 3)."""
    ahead = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(ahead, axis=2)
    back = -np.roll(ahead, 1, axis=1)
    scale = np.maximum(lengths * np.roll(lengths, 1, axis=1), np.finfo(float).tiny)
    return np.arccos(np.clip((ahead * back).sum(axis=2) / scale, -1, 1))


def _meeting_corners(places: Ints, units: Floats) -> tuple[Ints, Ints]:
    """Pairs of corners at one place whose triangles share an edge that is no crease."""
    start, end = places.ravel(), np.roll(places, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * (places.max() + 1) + high
    order = np.argsort(key, kind="stable")
    is_shared = key[order][1:] == key[order][:-1]
    one, other = order[:-1][is_shared], order[1:][is_shared]
    cosine = np.einsum("ek,ek->e", units[one // 3], units[other // 3])
    one, other = one[cosine > math.cos(CREASE_RAD)], other[cosine > math.cos(CREASE_RAD)]
    # An edge runs from its own corner to the next one; its neighbour runs the other way, or the same.
    next_one, next_other = _following(one), _following(other)
    is_same_way = start[one] == start[other]
    first = np.concatenate([one, next_one])
    second = np.concatenate(
        [np.where(is_same_way, other, next_other), np.where(is_same_way, next_other, other)]
    )
    return first, second


def _following(corner: Ints) -> Ints:
    return corner // 3 * 3 + (corner % 3 + 1) % 3
