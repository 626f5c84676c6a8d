import dataclasses
import math

import gymnasium
import numpy as np
import pytest

from agent.config import EnvConfig
from agent.envs.episodes import fixed_episodes
from agent.envs.pointnav import PointNavEnv
from agent.rollout import run_episode
from agent.systems.controls import CONTROL_NAMES, CONTROLS, make_control
from agent.systems.oracle import make_oracle
from langwm_data.config_io import ConfigError

CONFIG = EnvConfig(distance_edges_m=(1.0, 2.0, 3.0, 5.0), is_blind=True)


@pytest.fixture(scope="module")
def env(small_scene):
    env = PointNavEnv(CONFIG, scenes=[small_scene])
    yield env
    env.close()


@pytest.fixture(scope="module")
def episodes(small_scene):
    return fixed_episodes(CONFIG, "test", 12, [small_scene])


def test_the_oracle_arrives_by_nearly_the_shortest_way(env, episodes):
    oracle = make_oracle(gymnasium.wrappers.OrderEnforcing(env))
    records = [run_episode(env, oracle, episode=e) for e in episodes]
    assert all(r.success for r in records)
    assert np.mean([r.spl for r in records]) > 0.98
    straight = [math.dist(e.start_xy, e.goal_xy) for e in episodes]
    assert any(e.geodesic_distance > 1.03 * d for e, d in zip(episodes, straight, strict=True))


def test_those_that_are_not_told_the_way_do_worse(env, episodes):
    arrived = {
        name: sum(run_episode(env, make_control(name, env), episode=e).success for e in episodes)
        for name in CONTROLS
    }
    assert all(count < len(episodes) for count in arrived.values())
    assert arrived["turn-to-goal"] > arrived["random"]


def test_it_turns_on_the_spot_first(env, episodes):
    episode = dataclasses.replace(episodes[0], start_yaw=0.0)
    oracle = make_oracle(env)
    seen = []
    for yaw in (0.0, 2.0, -2.0):
        obs, _ = env.reset(options={"episode": dataclasses.replace(episode, start_yaw=yaw)})
        seen.append(oracle(obs, None)[0])
    assert sum(action[0] == 0 for action in seen) >= 2
    assert all(env.action_space.contains(action) for action in seen)


def test_an_environment_that_knows_no_way_is_refused(make_room):
    with pytest.raises(
        ValueError, match="the oracle needs PointNavEnv, which knows the way; EmptyRoom does not"
    ):
        make_oracle(make_room())


def test_an_unknown_control_is_refused(env):
    allowed = "random, straight-ahead, turn-to-goal, oracle"
    assert ", ".join(CONTROL_NAMES) == allowed
    with pytest.raises(ConfigError, match=f"control 'ghost' is unknown; allowed: {allowed}"):
        make_control("ghost", env)


@pytest.mark.parametrize("action", ["velocity", "wheel", "kinematic"])
@pytest.mark.parametrize("protocol", ["igibson", "habitat"])
def test_controls_speak_the_language_of_every_environment(action, protocol, small_scene, episodes):
    config = dataclasses.replace(CONFIG, action=action, protocol=protocol, contacts="map", max_steps=200)
    env = PointNavEnv(config, scenes=[small_scene])
    records = {
        name: [run_episode(env, make_control(name, env), episode=e) for e in episodes[:6]]
        for name in CONTROL_NAMES
    }
    env.close()
    assert all(r.success for r in records["oracle"])
    assert np.mean([r.spl for r in records["oracle"]]) > 0.9
    near = [r for r in records["turn-to-goal"] if r.success]
    assert len(near) > sum(r.success for r in records["random"])
    straight = records["straight-ahead"][0].trajectory
    assert np.abs(straight[:, 2] - straight[0, 2]).max() < 1e-9
