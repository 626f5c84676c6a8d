import numpy as np
import pytest
from gymnasium import spaces

from agent.envs.features import FeatureEnv
from agent.rollout import Collector


def describe(obs, info):
    return np.array([1 / 3, obs["task"][0], len(info["objects"])], np.float32)


@pytest.fixture
def env(make_room):
    return FeatureEnv(make_room(max_steps=3), describe, 3)


def test_every_observation_has_the_vector_in_half_precision(env):
    seen = [env.reset(seed=0)[0], env.step(np.zeros(2))[0]]
    for obs in seen:
        assert obs["features"].dtype == np.float32
        assert obs["features"][0] == np.float16(1 / 3) != np.float32(1 / 3)
        assert obs["features"][1] == np.float16(obs["task"][0])
    assert isinstance(env.observation_space, spaces.Dict)
    assert env.observation_space.contains(seen[1])


def test_the_rest_is_that_of_the_environment_inside(env, make_room):
    plain = make_room(max_steps=3)
    for ours, theirs in ((env.reset(seed=1), plain.reset(seed=1)),):
        np.testing.assert_array_equal(ours[0]["task"], theirs[0]["task"])
    for _ in range(3):
        ours, theirs = env.step(np.ones(2)), plain.step(np.ones(2))
        np.testing.assert_array_equal(ours[0]["rgb"], theirs[0]["rgb"])
        assert ours[1:4] == theirs[1:4]


def test_what_is_collected_is_what_was_seen(env):
    collector, seen = Collector(env, seed=4), []

    def policy(obs, state):
        seen.append(obs["features"])
        return np.ones(2, np.float32), None

    finished = None
    while finished is None:
        finished = collector.step(policy)
    stored = finished.replay.features["features"]
    assert stored.dtype == np.float16
    np.testing.assert_array_equal(stored[:3].astype(np.float32), np.stack(seen))
    assert stored.shape == (4, 3)
