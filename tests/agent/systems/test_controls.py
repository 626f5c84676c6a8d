import numpy as np

from agent.config import EnvConfig
from agent.rollout import run_episode
from agent.systems.controls import CONTROLS, make_random_policy, make_straight_ahead, make_turn_to_goal


def test_turn_to_goal_arrives_in_an_empty_room(make_room):
    records = [run_episode(make_room(), make_turn_to_goal(EnvConfig()), seed=seed) for seed in range(20)]
    assert all(r.success for r in records)
    assert np.mean([r.spl for r in records]) > 0.9


def test_random_actions_differ_between_episodes_and_repeat_within_one(make_room):
    walks = [run_episode(make_room(), make_random_policy(0), seed=s).trajectory for s in (1, 1, 2)]
    np.testing.assert_array_equal(walks[0], walks[1])
    assert np.abs(walks[0][:5, :2] - walks[2][:5, :2]).max() > 1e-3


def test_random_actions_fill_their_range():
    policy, state, actions = make_random_policy(0), None, []
    for _ in range(500):
        action, state = policy({"task": np.zeros(4, np.float32)}, state)
        actions.append(action)
    assert np.abs(np.mean(actions, 0)).max() < 0.1
    assert np.std(actions, 0).min() > 0.5


def test_straight_ahead_never_turns(make_room):
    walk = run_episode(make_room(), make_straight_ahead(EnvConfig()), seed=0).trajectory
    assert np.ptp(walk[:, 2]) < 1e-9


def test_controls_have_the_names_of_the_tables():
    assert set(CONTROLS) == {"random", "straight-ahead", "turn-to-goal"}
