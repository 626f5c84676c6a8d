"""Fewer triangles within a stated error: vertices slide into a neighbour as long as no surface moves too far.

A vertex may move if its neighbour lies in the planes of all its triangles and what is left of them still
passes by where it was, both up to the error. Borders, creases, seams of textures and edges between
materials are lines that a vertex on them may only move along, and those lines keep to the same error.
Vertices that stay do so exactly. In each pass it is the turn of vertices that share no triangle, so their
moves do not touch. Same mesh, same result.

Errors of moves one after another add up, which is safe and wasteful: on a finely cut ball a third of
the stated error is reached.

Source: ours (half-edge collapses in independent sets; error bookkeeping per triangle).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.meshes.distances import to_segments, to_triangles
from langwm_data.scenes.meshes.normals import (
    face_vectors,
    mean_normals,
    smooth_normals,
    welded,
)
from langwm_data.scenes.meshes.obj import unique_columns
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.seeding import make_rng

STAGES = (0.2, 0.5, 1.0)
"""Shares of the error that are allowed one after another, so that cheap moves come before dear ones."""
MAX_PASSES = 40
"""In each stage."""
WORTHWHILE = 0.002
"""A stage ends when a pass moves fewer vertices than this share of the triangles."""
MIN_COSINE = 0.3
"""A triangle may turn by as much as this in one move; more would fold the surface over."""

_SEED = 0
"""Whose turn it is does not depend on a user's seed: a mesh means the same thing in every dataset."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """A mesh while it shrinks. A wedge is a vertex with one material, texture place and normal."""

    points: Floats
    """(P, 3), metres: the places that vertices take."""
    place: Ints
    """(W,), of every wedge."""
    triangles: Ints
    """(T, 3), wedges."""
    group: Ints
    """(T,), material."""
    error: Floats
    """(T,), metres: how far the surface that a triangle stands for may be from it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moves:
    """Vertices that could slide into a neighbour."""

    start: Ints
    """(M,), places, ascending."""
    end: Ints
    """(M,), places."""


def decimate(mesh: TriangleMesh, max_error_m: float) -> TriangleMesh:
    """The same surface in fewer triangles, nowhere further than ``max_error_m`` from where it was.

    Normals follow from the new faces, smooth where the old ones were (see ``normals``). Texture places are
    kept at the vertices that stay, and run straight between them.
    """
    state, fan, uvs = _begin(mesh)
    for stage, share in enumerate(STAGES):
        for number in range(MAX_PASSES):
            rng = make_rng(_SEED, "decimate", stage, number)
            state, num_moved = _pass(rng, state, share * max_error_m)
            if num_moved <= WORTHWHILE * len(state.triangles):
                break
    return _finished(state, fan, uvs, mesh)


def _begin(mesh: TriangleMesh) -> tuple[_State, Ints, NDArray[np.float32]]:
    """The mesh in wedges, and for each of them the smooth surface around it and its place on the texture."""
    vertices = mesh.vertices.astype(np.float64)
    corners = mesh.triangles.astype(np.int64)
    is_solid = np.linalg.norm(face_vectors(vertices, corners), axis=1) > 0
    corners, group = corners[is_solid], mesh.group_of_triangles()[is_solid].astype(np.int64)
    _, fan = smooth_normals(vertices, corners)
    places = welded(vertices)
    points = np.zeros((places.max() + 1, 3))
    points[places] = vertices
    texture_place = welded(mesh.uvs.astype(np.float64))
    keys = np.stack([places[corners], np.repeat(group[:, None], 3, axis=1), texture_place[corners], fan])
    first, wedge = unique_columns(keys.reshape(4, -1))
    vertex = corners.ravel()[first]
    state = _State(
        points=points,
        place=places[vertex],
        triangles=wedge.reshape(-1, 3),
        group=group,
        error=np.zeros(len(corners)),
    )
    return state, fan.ravel()[first], mesh.uvs[vertex]


def _finished(state: _State, fan: Ints, uvs: NDArray[np.float32], mesh: TriangleMesh) -> TriangleMesh:
    used, triangles = np.unique(state.triangles, return_inverse=True)
    normals = mean_normals(state.points, state.place[state.triangles], fan[state.triangles])
    groups, sizes = np.unique(state.group, return_counts=True)
    return replace(
        mesh,
        vertices=state.points[state.place[used]].astype(np.float32),
        normals=normals[fan[used]].astype(np.float32),
        uvs=uvs[used],
        triangles=triangles.reshape(-1, 3).astype(np.int32),
        sizes=tuple(sizes.tolist()),
        materials=tuple(mesh.materials[g] for g in groups),
    )


def _pass(rng: np.random.Generator, state: _State, max_error_m: float) -> tuple[_State, int]:
    """Let some vertices that share no triangle make their best moves; say how many did."""
    pairs = _wedge_pairs(state, _has_turn(rng, state))
    moves = _possible_moves(state, pairs)
    if not len(moves.start):
        return state, 0
    errors = _errors(state, moves)
    length = np.linalg.norm(state.points[moves.start] - state.points[moves.end], axis=1)
    order = np.lexsort((moves.end, length, errors, moves.start))
    best = order[np.unique(moves.start[order], return_index=True)[1]]
    best = best[errors[best] <= max_error_m]
    chosen = _Moves(start=moves.start[best], end=moves.end[best])
    return _moved(state, chosen, errors[best], pairs), len(best)


def _has_turn(rng: np.random.Generator, state: _State) -> NDArray[np.bool_]:
    """(P,): places that drew the lowest number in all of their triangles."""
    draw = rng.permutation(len(state.points))
    places = state.place[state.triangles]
    draws = draw[places]
    is_lowest = draws == draws.min(axis=1, keepdims=True)
    has_turn = np.zeros(len(state.points), bool)
    has_turn[places.ravel()] = True
    has_turn[places[~is_lowest]] = False
    return has_turn


def _wedge_pairs(state: _State, has_turn: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """All different (wedge, wedge) that an edge joins, the first one's place having its turn."""
    start, end = state.triangles.ravel(), np.roll(state.triangles, -1, axis=1).ravel()
    start, end = np.concatenate([start, end]), np.concatenate([end, start])
    is_asked = has_turn[state.place[start]]
    num = len(state.place)
    key = np.unique(start[is_asked] * num + end[is_asked])
    return key // num, key % num


def _possible_moves(state: _State, pairs: tuple[Ints, Ints]) -> _Moves:
    """Moves that give every wedge of a vertex one wedge of its neighbour to become.

    A vertex on a seam has a wedge on each side, so it can move along the seam only.
    """
    wedge, other = pairs
    num = len(state.points)
    needed = np.bincount(state.place[np.unique(wedge)], minlength=num)
    key, count = np.unique(wedge * num + state.place[other], return_counts=True)
    wedge, end = key[count == 1] // num, key[count == 1] % num
    move, num_wedges = np.unique(state.place[wedge] * num + end, return_counts=True)
    start, end = move // num, move % num
    is_whole = num_wedges == needed[start]
    return _Moves(start=start[is_whole], end=end[is_whole])


def _errors(state: _State, moves: _Moves) -> Floats:
    """(M,): how far the surface would be from where it began, infinite where it would fold over."""
    is_asked = np.zeros(len(state.points), bool)
    is_asked[moves.start] = True
    so_far, away = _across_surface(state, moves, is_asked)
    return so_far + np.maximum(away, _across_lines(state, moves, is_asked))


def _sorted_by(places: Ints, num_places: int) -> tuple[Ints, Ints]:
    """The order that sorts ``places``, and where each of 0, 1, ... begins in it, with the end of the last."""
    starts = np.concatenate([[0], np.cumsum(np.bincount(places, minlength=num_places))])
    return np.argsort(places, kind="stable"), starts


def _rows(starts: Ints, places: Ints) -> tuple[Ints, Ints]:
    """For each of ``places`` all entries from its start to the next: (which place, which entry)."""
    counts = starts[places + 1] - starts[places]
    owner = np.repeat(np.arange(len(places)), counts)
    before = np.cumsum(counts) - counts
    return owner, np.arange(len(owner)) - before[owner] + starts[places][owner]


def _across_surface(state: _State, moves: _Moves, is_asked: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """(M,) twice: the error so far around each vertex, and how far the surface would move there."""
    points, all_places = state.points, state.place[state.triangles]
    corners = np.flatnonzero(is_asked[all_places].ravel())
    order, starts = _sorted_by(all_places.ravel()[corners], len(points))
    owner, entry = _rows(starts, moves.start)
    corner = corners[order[entry]]
    places = all_places[corner // 3]
    row = np.arange(len(corner))
    first, second, third = (points[places[row, (corner + k) % 3]] for k in range(3))
    end = points[moves.end[owner]]
    old, new = np.cross(second - first, third - first), np.cross(second - end, third - end)
    old /= np.maximum(np.linalg.norm(old, axis=1, keepdims=True), np.finfo(float).tiny)
    vanishes = (places == moves.end[owner][:, None]).any(axis=1)
    turn = np.einsum("rk,rk->r", new, old)
    folds = ~vanishes & (turn <= MIN_COSINE * np.linalg.norm(new, axis=1))
    height = np.abs(np.einsum("rk,rk->r", end - first, old))
    passing = to_triangles(first, end, second, third)
    begin = np.flatnonzero(np.diff(owner, prepend=-1))
    so_far = np.maximum.reduceat(state.error[corner // 3], begin)
    away = np.maximum.reduceat(np.where(folds, np.inf, height), begin)
    return so_far, np.maximum(away, np.minimum.reduceat(np.where(vanishes, np.inf, passing), begin))


def _across_lines(state: _State, moves: _Moves, is_asked: NDArray[np.bool_]) -> Floats:
    """(M,): how far border lines through a vertex would move, infinite if it left them; 0 without any.

    A border is an edge of wedges that only one triangle has: an open edge, a crease or a seam.
    """
    one, other = _borders(state, is_asked)
    order, starts = _sorted_by(one, len(state.points))
    owner, entry = _rows(starts, moves.start)
    start, end, far = moves.start[owner], moves.end[owner], other[order[entry]]
    points = state.points
    distance = to_segments(points[start], points[end], points[far])
    away = np.zeros(len(moves.start))
    np.maximum.at(away, owner, np.where(far == end, 0, distance))
    stays = np.zeros(len(moves.start), bool)
    stays[owner[far == end]] = True
    return np.where(stays | (starts[moves.start] == starts[moves.start + 1]), away, np.inf)


def _borders(state: _State, is_asked: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """The places at both ends of every border edge at one of the asked places, in both directions."""
    start, end = state.triangles.ravel(), np.roll(state.triangles, -1, axis=1).ravel()
    is_near = is_asked[state.place[start]] | is_asked[state.place[end]]
    start, end = start[is_near], end[is_near]
    key = np.minimum(start, end) * len(state.place) + np.maximum(start, end)
    _, index, count = np.unique(key, return_index=True, return_counts=True)
    one, other = state.place[start[index[count == 1]]], state.place[end[index[count == 1]]]
    return np.concatenate([one, other]), np.concatenate([other, one])


def _moved(state: _State, moves: _Moves, errors: Floats, pairs: tuple[Ints, Ints]) -> _State:
    """Make the moves: wedges become those of the neighbours, triangles between the two vanish."""
    end_of = np.full(len(state.points), -1)
    end_of[moves.start] = moves.end
    error_of = np.zeros(len(state.points))
    error_of[moves.start] = errors
    wedge, other = pairs
    is_taken = end_of[state.place[wedge]] == state.place[other]
    becomes = np.arange(len(state.place))
    becomes[wedge[is_taken]] = other[is_taken]
    error = np.maximum(state.error, error_of[state.place[state.triangles]].max(axis=1))
    triangles = becomes[state.triangles]
    a, b, c = state.place[triangles].T
    is_left = (a != b) & (b != c) & (c != a)
    return replace(state, triangles=triangles[is_left], group=state.group[is_left], error=error[is_left])
