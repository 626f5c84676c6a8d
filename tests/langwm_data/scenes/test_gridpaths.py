import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra

from langwm_data.scenes.gridpaths import (
    in_sight,
    largest_component,
    move_graph,
    spread,
    spread_once,
    with_source,
)


def lengths_from(free, cell):
    """Shortest ways over the move graph from one cell, in cells."""
    number = int(free.ravel()[: cell[0] * free.shape[1] + cell[1]].sum())
    values = np.full(free.shape, np.inf)
    values[free] = dijkstra(move_graph(free), indices=number)
    return values


def test_sixteen_moves_have_their_own_lengths():
    values = lengths_from(np.ones((7, 7), bool), (3, 3))
    assert values[4, 3] == 1
    assert values[4, 4] == pytest.approx(math.sqrt(2))
    assert values[5, 4] == pytest.approx(math.sqrt(5))
    assert values[1, 2] == pytest.approx(math.sqrt(5))


def test_lengths_in_the_open_are_at_most_two_point_eight_percent_too_long():
    values = lengths_from(np.ones((61, 61), bool), (30, 30))
    i, j = np.indices(values.shape) - 30
    exact = np.maximum(np.hypot(i, j), 1e-9)
    ratio = (values / exact)[np.hypot(i, j) > 0]
    assert ratio.min() > 1 - 1e-9
    assert ratio.max() < 1.028


def test_no_move_cuts_a_corner():
    free = np.array([[1, 0, 1], [1, 1, 1], [1, 1, 1]], bool)
    values = lengths_from(free, (0, 0))
    assert values[1, 1] == 2  # not diagonally past the blocked cell
    assert values[0, 2] == 4


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_the_graph_is_symmetric_and_joins_what_hangs_together(seed):
    free = largest_component(np.random.default_rng(seed).random((12, 15)) < 0.7)
    graph = move_graph(free)
    assert abs(graph - graph.T).max() == 0
    assert np.isfinite(dijkstra(graph, indices=0)).all()


def test_the_largest_component_wins():
    free = np.zeros((5, 9), bool)
    free[1:4, 1:3] = free[0, 4:6] = True
    assert np.array_equal(largest_component(free), free & (np.arange(9) < 3))
    assert not largest_component(np.zeros((3, 3), bool)).any()


def test_a_source_leads_to_its_cells_and_nothing_leads_back():
    graph = with_source(move_graph(np.ones((1, 4), bool)), np.array([3]), np.array([0.5]))
    assert dijkstra(graph, indices=4).tolist() == [3.5, 2.5, 1.5, 0.5, 0]
    assert np.isinf(dijkstra(graph, indices=0)[4])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_sight_agrees_with_walking_every_line(seed):
    rng = np.random.default_rng(seed)
    free = rng.random((14, 18)) < 0.85
    at = np.array([7.3, 9.6])
    free[7, 9] = True
    seen, roomy = in_sight(free, at), ndimage.binary_erosion(free, np.ones((3, 3)), border_value=1)
    t = np.linspace(0, 1, 400)[:, None]
    for cell in np.argwhere(free):
        line = np.floor(at + t * (cell + 0.5 - at)).astype(int)
        blocked = (~free[tuple(line.T)]).mean() * np.linalg.norm(cell + 0.5 - at)
        if seen[tuple(cell)]:
            assert blocked < 0.5, cell  # a line may graze a corner
        if roomy[tuple(line.T)].all():
            assert seen[tuple(cell)], cell


def test_in_an_empty_grid_everything_is_seen():
    assert in_sight(np.ones((20, 30), bool), np.array([3.2, 7.9])).all()


def test_values_spread_through_a_mask_and_one_cell_beyond():
    values = np.array([[0.0, np.inf, np.inf, np.inf, np.inf]])
    into = np.array([[False, True, True, False, True]])
    assert spread(values, into).tolist() == [[0, 1, 2, math.inf, math.inf]]
    assert spread_once(spread(values, into)).tolist() == [[0, 1, 2, 3, math.inf]]
