import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from agent.config import EnvConfig
from agent.envs.make import make_env
from agent.rollout import run_episode
from benchmarks.known_tasks import PixelPendulum
from langwm_data.config import CameraConfig

CAMERA = CameraConfig(height=32, width=32)


def to_goal(obs, state):
    return np.clip(obs["task"] / 0.2, -1, 1).astype(np.float32), state


def test_who_drives_to_the_goal_reaches_it_and_earns_the_way_and_one():
    env = make_env(EnvConfig(id="KnownTasks/Reach-v0", camera=CAMERA))
    outcome = run_episode(env, to_goal, seed=3)
    assert outcome.success
    assert outcome.is_terminated
    env.reset(seed=3)
    way = float(np.linalg.norm(env.unwrapped._goal - env.unwrapped._place))
    assert way + 1 - 0.2 <= outcome.total_reward <= way + 1
    still = run_episode(env, lambda obs, state: (np.zeros(2, np.float32), state), seed=3)
    assert (still.success, still.is_terminated, still.num_steps, still.total_reward) == (
        False,
        False,
        30,
        0.0,
    )


def test_the_frame_shows_where_goal_and_point_are():
    env = make_env(EnvConfig(id="KnownTasks/Reach-v0", kwargs={"tells": False}, camera=CAMERA))
    obs, _ = env.reset(seed=3)
    assert obs["task"].shape == (1,)
    for channel, point in ((0, env.unwrapped._goal), (2, env.unwrapped._place)):
        rows, columns = np.nonzero(obs["rgb"][..., channel])
        seen = np.array([columns.mean() + 0.5, rows.mean() + 0.5]) / 16 - 1
        np.testing.assert_allclose(seen * (1, -1), point, atol=0.1)


def test_boxes_of_goal_and_point_are_those_of_the_frame():
    kwargs = {"tells": False, "labels": True}
    env = make_env(EnvConfig(id="KnownTasks/Reach-v0", kwargs=kwargs, camera=CAMERA))
    obs, info = env.reset(seed=3)
    assert [o.category for o in info["objects"]] == ["chair", "table"]
    for channel, thing in ((0, info["objects"][0]), (2, info["objects"][1])):
        rows, columns = np.nonzero(obs["rgb"][..., channel])
        drawn = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        np.testing.assert_allclose(thing.bbox_xyxy, drawn, atol=1)


def test_depth_is_how_far_the_boxes_are_said_to_be_away_and_the_wall_behind_them():
    kwargs = {"tells": False, "labels": True, "depth": True}
    env = make_env(EnvConfig(id="KnownTasks/Reach-v0", kwargs=kwargs, camera=CAMERA))
    obs, info = env.reset(seed=3)
    red, blue = obs["rgb"][..., 0] > 0, obs["rgb"][..., 2] > 0
    goal, point = (thing.distance_m for thing in info["objects"])
    assert 1 <= goal <= 2
    assert 3 <= point <= 4
    np.testing.assert_allclose(obs["depth"][red], goal, rtol=1e-6)
    np.testing.assert_allclose(obs["depth"][blue & ~red], point, rtol=1e-6)
    assert (obs["depth"][~red & ~blue] == 5).all()


def test_lower_in_the_frame_is_nearer():
    env = make_env(EnvConfig(id="KnownTasks/Reach-v0", kwargs={"labels": True, "depth": True}, camera=CAMERA))
    seen = [env.reset(seed=seed)[1]["objects"] for seed in range(5)]
    for goals_or_points in zip(*seen, strict=True):
        from_below = sorted(goals_or_points, key=lambda o: -o.bbox_xyxy[3])
        distances = [o.distance_m for o in from_below]
        assert distances == sorted(set(distances))


def brake(obs, state):
    """Push towards the middle, minding the speed; both are taken from the frames."""
    columns = np.flatnonzero(obs["rgb"][16, :, 0])
    place = float((columns.mean() + 0.5 - 16) / 12)
    speed = 0.0 if state is None else place - state
    return np.clip([-4 * (place + 6 * speed)], -1, 1).astype(np.float32), place


def test_who_sees_the_mass_on_the_line_brings_it_to_rest():
    env = make_env(EnvConfig(id="KnownTasks/Line-v0", camera=CAMERA))
    still = [
        run_episode(env, lambda obs, state: (np.zeros(1), state), seed=s).total_reward for s in range(10)
    ]
    seen = [run_episode(env, brake, seed=s).total_reward for s in range(10)]
    assert np.mean(seen) > -4
    assert np.mean(still) < -15


def test_the_line_can_be_black():
    env = make_env(EnvConfig(id="KnownTasks/Line-v0", kwargs={"is_blind": True}, camera=CAMERA))
    assert not env.reset(seed=0)[0]["rgb"].any()


def test_rewards_of_the_pendulum_are_a_tenth():
    def play(env):
        env.reset(seed=0)
        return [env.step(np.array([x], np.float32))[1] for x in (0.5, -1.0, 0.2)]

    ours = play(make_env(EnvConfig(id="KnownTasks/Pendulum-v0", camera=CAMERA)))
    theirs = play(
        gymnasium.wrappers.RescaleAction(gymnasium.make("Pendulum-v1"), np.float32(-1), np.float32(1))
    )
    assert ours == pytest.approx([0.1 * r for r in theirs])


@pytest.mark.parametrize(("angle", "row", "column"), [(0.0, 3, 16), (math.pi, 29, 16), (math.pi / 2, 16, 3)])
def test_the_drawn_bar_points_where_gymnasiums_does(angle, row, column):
    picture = PixelPendulum().observation(np.array([math.cos(angle), math.sin(angle), 0.0]))["rgb"]
    assert picture[row, column].min() > 200
    opposite = picture[::-1, ::-1][row, column]
    assert opposite.max() == 0


def test_the_pendulum_can_be_black():
    env = make_env(EnvConfig(id="KnownTasks/Pendulum-v0", kwargs={"is_blind": True}, camera=CAMERA))
    assert not env.reset(seed=0)[0]["rgb"].any()


@pytest.mark.parametrize("task", ["Reach-v0", "Line-v0", "Pendulum-v0"])
def test_known_tasks_are_environments(task):
    check_env(gymnasium.make(f"KnownTasks/{task}").unwrapped, skip_render_check=True)


def test_reach_with_depth_is_an_environment():
    check_env(gymnasium.make("KnownTasks/Reach-v0", depth=True).unwrapped, skip_render_check=True)
