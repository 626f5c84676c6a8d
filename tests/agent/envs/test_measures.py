import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.envs.measures import EpisodeMeasures, path_efficiency, soft_spl, spl

lengths = st.floats(0, 100, allow_nan=False)


def test_spl_by_hand():
    assert spl(True, 4.0, 5.0) == pytest.approx(0.8)
    assert spl(False, 4.0, 5.0) == 0.0


def test_a_path_shorter_than_the_shortest_counts_as_perfect():
    assert spl(True, 4.0, 3.7) == 1.0


def test_soft_spl_by_hand():
    # Three quarters of the way covered, on a path twice as long as needed.
    assert soft_spl(1.0, 4.0, 8.0) == pytest.approx(0.75 * 0.5)


def test_moving_away_scores_nothing():
    assert soft_spl(6.0, 4.0, 2.0) == 0.0


def test_starting_on_the_goal_divides_by_nothing():
    assert spl(True, 0.0, 0.0) == 1.0
    assert spl(True, 0.0, 2.0) == 0.0
    assert soft_spl(0.0, 0.0, 0.0) == 1.0
    assert soft_spl(1.0, 0.0, 1.0) == 0.0


def test_an_unreachable_goal_scores_nothing():
    assert path_efficiency(math.inf, 3.0) == 0.0
    assert soft_spl(math.inf, math.inf, 3.0) == 0.0


@given(shortest=lengths, path=lengths, final=lengths)
def test_scores_lie_between_zero_and_one(shortest, path, final):
    assert 0.0 <= soft_spl(final, shortest, path) <= 1.0
    assert 0.0 <= spl(True, shortest, path) <= 1.0


@given(shortest=lengths, path=lengths)
def test_soft_spl_of_an_arrival_is_spl(shortest, path):
    assert soft_spl(0.0, shortest, path) == spl(True, shortest, path)


def test_the_last_step_counts_in_the_path():
    measures = EpisodeMeasures(geodesic_distance=0.7, position=(0.0, 0.0), distance_to_goal=0.7)
    measures.update((0.3, 0.4), 0.5, is_collision=True, is_success=False)
    measures.update((0.3, 0.9), 0.0, is_collision=False, is_success=True)
    assert measures.as_info() == {
        "success": True,
        "spl": pytest.approx(0.7),
        "soft_spl": pytest.approx(0.7),
        "distance_to_goal": 0.0,
        "path_length": pytest.approx(1.0),
        "geodesic_distance": 0.7,
        "collisions": 1,
    }
