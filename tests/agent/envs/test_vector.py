"""Vectors of environments: Gymnasium's own modes and ours give what the plain environment gives."""

from functools import partial

import gymnasium
import numpy as np
import pytest
from fragile_env import Fragile
from gymnasium.vector import AutoresetMode

import agent  # noqa: F401  # registers the environment
from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from agent.envs.vector import EnvCrashedError, RestartingVectorEnv
from langwm_data.config import CameraConfig, RenderConfig

CONFIG = EnvConfig(
    camera=CameraConfig(height=12, width=16),
    render=RenderConfig(texture_px=16),
    distance_edges_m=(1.0, 2.0, 4.0),
    max_steps=5,
)
STEPS = 13
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (STEPS, 2, 2)).astype(np.float32)


def make_env(scene):
    return PointNavEnv(CONFIG, scenes=[scene])


def plain(scene, number, mode):
    """What an environment gives, reset by hand when ``mode`` says; the first entry is the first reset."""
    env = make_env(scene)
    obs, _ = env.reset(seed=3 + number)
    seen, is_over = [(obs, 0.0, False, env.episode)], False
    for actions in ACTIONS:
        if is_over and mode == AutoresetMode.NEXT_STEP:
            (obs, _), reward, is_over = env.reset(), 0.0, False
        else:
            obs, reward, terminated, truncated, _ = env.step(actions[number])
            is_over = terminated or truncated
            if is_over and mode != AutoresetMode.NEXT_STEP:
                obs, _ = env.reset()
        seen.append((obs, reward, is_over, env.episode))
    env.close()
    return seen


def make_vector(kind, scene, mode):
    if kind == "ours":
        return RestartingVectorEnv(partial(make_env, scene), 2, autoreset_mode=mode)
    options = {"autoreset_mode": mode} | ({"context": "spawn"} if kind == "async" else {})
    return gymnasium.make_vec(
        "LangWM/PointNav-v0",
        num_envs=2,
        vectorization_mode=kind,
        vector_kwargs=options,
        config=CONFIG,
        scenes=[scene],
    )


@pytest.mark.parametrize(
    ("kind", "mode"),
    [
        *(("sync", mode) for mode in AutoresetMode),
        ("async", AutoresetMode.NEXT_STEP),  # the others are Gymnasium's own code, and slow to start
        *(("ours", mode) for mode in AutoresetMode),
    ],
)
def test_a_vector_gives_what_the_plain_environment_gives(kind, mode, small_scene):
    expected = [plain(small_scene, number, mode) for number in range(2)]
    vector = make_vector(kind, small_scene, mode)
    try:
        assert vector.metadata["autoreset_mode"] == mode
        obs, _ = vector.reset(seed=3)
        reward, is_over = np.zeros(2), np.zeros(2, bool)
        for step in range(STEPS + 1):
            if step:
                obs, reward, terminated, truncated, _ = vector.step(ACTIONS[step - 1])
                is_over = terminated | truncated
                if is_over.any() and mode == AutoresetMode.DISABLED:
                    obs, _ = vector.reset(options={"reset_mask": is_over})
            for number, (own, own_reward, own_over, _) in enumerate(e[step] for e in expected):
                for name in own:
                    np.testing.assert_array_equal(obs[name][number], own[name])
                assert (reward[number], is_over[number]) == (own_reward, own_over)
        assert len({e[3].start_xy for own in expected for e in own}) >= 5
    finally:
        vector.close()


def play_fragile(tmp_path, how, crashes, max_restarts=2):
    marker = tmp_path / f"{how}{crashes}"
    marker.write_text("x" * crashes)
    vector = RestartingVectorEnv(partial(Fragile, marker, how), 2, max_restarts=max_restarts)
    try:
        seen = [vector.reset(seed=1)[0]]
        return [*seen, *(vector.step(np.full((2, 1), 0.1 * step))[0] for step in range(9))]
    finally:
        vector.close()


@pytest.mark.parametrize("how", ["raises", "dies"])
def test_an_environment_that_breaks_goes_on_where_it_was(how, tmp_path, caplog):
    expected = play_fragile(tmp_path, how, 0)
    np.testing.assert_array_equal(play_fragile(tmp_path, how, 2), expected)
    reason = "the wheels came off" if how == "raises" else "its process ended with exit code -9"
    assert reason in caplog.text
    assert "is started again" in caplog.text


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("raises", r"(?s)environment . broke 2 times in one episode.*in step.*RuntimeError: the wheels"),
        ("dies", "broke 2 times in one episode; the last time: its process ended with exit code -9"),
    ],
)
def test_what_breaks_again_and_again_ends_with_the_traceback_of_its_process(how, message, tmp_path):
    with pytest.raises(EnvCrashedError, match=message):
        play_fragile(tmp_path, how, 20, max_restarts=1)


def test_steps_beside_a_refused_one_are_taken_again_after_a_break(tmp_path):
    """One environment refuses its action; the other takes its step, and breaks later."""

    def play(crashes):
        marker = tmp_path / f"m{crashes}"
        marker.write_text("x" * crashes)
        vector = RestartingVectorEnv(partial(Fragile, marker, "raises"), 2)
        try:
            vector.reset(seed=1)
            with pytest.raises(ValueError, match="the action is not a number"):
                vector.step(np.array([[np.nan], [0.3]]))
            return [vector.step(np.full((2, 1), 0.1))[0] for _ in range(3)]
        finally:
            vector.close()

    np.testing.assert_array_equal(play(1), play(0))


def test_a_wrong_request_is_refused_without_a_restart(tmp_path):
    (tmp_path / "m").write_text("")
    vector = RestartingVectorEnv(partial(Fragile, tmp_path / "m", "dies"), 2)
    try:
        with pytest.raises(ValueError, match="reset option 'wrong' is unknown"):
            vector.reset(seed=1, options={"wrong": True})
        obs, _ = vector.reset(seed=1)
        assert obs.shape == (2, 2)
        assert vector.get_attr("count") == (0, 0)
    finally:
        vector.close()


def test_episodes_without_a_seed_differ(tmp_path):
    (tmp_path / "m").write_text("")
    vector = RestartingVectorEnv(partial(Fragile, tmp_path / "m", "dies"), 2)
    obs, _ = vector.reset()
    assert not np.array_equal(obs[0], obs[1])
    vector.close()


@pytest.mark.parametrize("change", [{"num_envs": 0}, {"max_restarts": -1}])
def test_impossible_numbers_are_refused(change):
    with pytest.raises(ValueError, match="give 1 or more environments and 0 or more restarts"):
        RestartingVectorEnv(partial(Fragile, None, "dies"), **({"num_envs": 1} | change))
