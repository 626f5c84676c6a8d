import json

import gymnasium
import numpy as np
import pytest

from agent.rollout import Collector, run_episode
from pretrain.frames import FrameObject


class LineEnv(gymnasium.Env):
    """A point on a line: driving adds up, the goal lies at 1, the seed sets the start and the colours."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self, max_steps=8, with_labels=True):
        self.max_steps = max_steps
        self.with_labels = with_labels

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seeds = [*getattr(self, "seeds", []), seed]
        self.options = options
        self.x = float(self.np_random.uniform(-0.2, 0.2))
        self.colour = self.np_random.integers(255, size=3, dtype=np.uint8)
        self.steps = 0
        return self.observe(), self.info()

    def step(self, action):
        self.x += 0.2 * float(action[0])
        self.steps += 1
        terminated = self.x >= 1
        truncated = not terminated and self.steps >= self.max_steps
        return self.observe(), 10.0 * terminated - 0.1, terminated, truncated, self.info()

    def observe(self):
        rgb = np.tile(self.colour + np.uint8(self.steps), (4, 6, 1))
        depth = np.full((4, 6), 2.0 - self.x, np.float32)
        task = np.array([1 - self.x, 0, 0, 0], np.float32)
        return {"rgb": rgb, "depth": depth, "task": task}

    def info(self):
        seen = FrameObject(category="chair", bbox_xyxy=(0.0, 0.0, 2.0, 2.0), center_x=1.0, distance_m=2.0)
        measures = {
            "success": self.x >= 1,
            "spl": 0.5,
            "soft_spl": 0.6,
            "distance_to_goal": 1 - self.x,
            "path_length": 0.2 * self.steps,
            "geodesic_distance": 1.0,
            "collisions": 0,
            "scene": "line",
            "tier": 0,
            "pose": np.array([self.x, 0.0, 0.0]),
            "goal": np.array([1.0, 0.0]),
        }
        return measures | ({"objects": [seen]} if self.with_labels else {})


def ahead(obs, state):
    return np.array([1.0, 0.0], np.float32), (state or 0) + 1


def noisy(seed):
    rng = np.random.default_rng(seed)
    return lambda obs, state: (rng.uniform(-1, 1, 2).astype(np.float32), state)


def collect(collector, policy, count):
    episodes = []
    while len(episodes) < count:
        if (done := collector.step(policy)) is not None:
            episodes.append(done)
    return episodes


def test_an_episode_is_played_to_its_success():
    record = run_episode(LineEnv(), ahead, seed=3)
    assert record.success
    assert record.is_terminated
    assert record.trajectory.shape == (record.num_steps + 1, 3)
    np.testing.assert_allclose(np.diff(record.trajectory[:, 0]), 0.2)
    assert record.total_reward == pytest.approx(10 - 0.1 * record.num_steps)


def test_a_timeout_is_not_a_termination():
    record = run_episode(LineEnv(), lambda obs, state: (np.zeros(2, np.float32), state), seed=3)
    assert not record.is_terminated
    assert not record.success
    assert record.num_steps == 8


def test_the_policy_sees_every_observation_and_its_own_state():
    seen = []

    def policy(obs, state):
        seen.append((float(obs["task"][0]), state))
        return ahead(obs, state)

    record = run_episode(LineEnv(), policy, seed=0)
    assert [s for _, s in seen] == [None, *range(1, record.num_steps)]
    np.testing.assert_allclose([d for d, _ in seen], 1 - record.trajectory[:-1, 0], atol=1e-6)


def test_collected_actions_stand_beside_what_they_led_to():
    done = collect(Collector(LineEnv(), seed=5), ahead, 1)[0]
    replay, length = done.replay, done.record.num_steps + 1
    assert len(replay.reward) == length
    assert (replay.action[0] == 0).all()
    assert (replay.action[1:, 0] == 1).all()
    assert replay.reward[0] == 0
    assert replay.reward[-1] == pytest.approx(9.9)
    assert replay.is_terminal
    np.testing.assert_allclose(replay.depth_mm[:, 0, 0], 1000 * (2 - done.record.trajectory[:, 0]), atol=0.51)
    assert [[o.category for o in frame] for frame in replay.objects] == [["chair"]] * length


def test_collecting_without_labels_gives_empty_tables():
    done = collect(Collector(LineEnv(with_labels=False), seed=5), ahead, 1)[0]
    assert all(len(o) == 0 for o in done.replay.objects)


def test_episodes_have_consecutive_seeds():
    env = LineEnv()
    collect(Collector(env, seed=40), ahead, 3)
    assert env.seeds == [40, 41, 42, 43]


def test_the_policy_state_begins_anew_with_every_episode():
    collector = Collector(LineEnv(), seed=5)
    collector.step(ahead)
    assert collector.policy_state == 1
    collect(collector, ahead, 1)
    assert collector.policy_state is None


@pytest.mark.parametrize("stop", [3, 11])
def test_collecting_goes_on_exactly_after_a_restart(stop):
    whole = Collector(LineEnv(), seed=7)
    policy = noisy(1)
    expected = collect(whole, policy, 3)

    first, policy = Collector(LineEnv(), seed=7), noisy(1)
    episodes = [e for _ in range(stop) if (e := first.step(policy)) is not None]
    state = json.loads(json.dumps(first.state_dict()))
    second = Collector(LineEnv(), seed=7, state=state)
    episodes += collect(second, policy, 3 - len(episodes))
    for a, b in zip(episodes, expected, strict=True):
        for name in ("rgb", "depth_mm", "task", "action", "reward"):
            np.testing.assert_array_equal(getattr(a.replay, name), getattr(b.replay, name))
        assert a.record.total_reward == b.record.total_reward


class OneBufferEnv(LineEnv):
    """Draws every frame into the same arrays, as some simulators do."""

    def observe(self):
        seen = super().observe()
        held = self.__dict__.setdefault("held", seen)
        for name, value in seen.items():
            held[name][...] = value
        return held


def test_an_environment_that_draws_into_one_buffer_is_remembered_step_by_step():
    plain, shared = (collect(Collector(e, seed=3), ahead, 1)[0].replay for e in (LineEnv(), OneBufferEnv()))
    assert len(np.unique(plain.rgb[:, 0, 0, 0])) == len(plain.rgb)
    for name in ("rgb", "depth_mm", "task"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(plain, name))
