"""The benchmarks of stage three, in seconds."""

import math

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from agent.systems.registry import load_agent_config
from benchmarks import pendulum, replay


@pytest.mark.parametrize(("angle", "row", "column"), [(0.0, 3, 16), (math.pi, 29, 16), (math.pi / 2, 16, 3)])
def test_the_drawn_bar_points_where_gymnasiums_does(angle, row, column):
    env = pendulum.PixelPendulum()
    picture = env.draw(np.array([math.cos(angle), math.sin(angle), 0.0]))["rgb"]
    assert picture[row, column].min() > 200
    opposite = picture[::-1, ::-1][row, column]
    assert opposite.max() == 0


def test_the_pendulum_is_an_environment():
    check_env(pendulum.PixelPendulum(), skip_render_check=True)
    obs, _ = pendulum.PixelPendulum(is_blind=True).reset(seed=0)
    assert obs["rgb"].max() == 0


def test_the_pendulums_loop_takes_as_many_updates_as_asked():
    overrides = {
        "steps": 400,
        "prefill_steps": 200,
        "update_every": 5,
        "sac": {"filters": 4, "hidden": 16, "batch_size": 4},
        "world_model": {"task": {"scale": [1.0]}},
    }
    config = load_agent_config("rad", overrides=overrides)
    rows = pendulum.learn(pendulum.PixelPendulum(), config, episodes=1, every=200)
    assert [(row["step"], row["updates"]) for row in rows] == [(200, 0), (400, 40)]
    assert -2000 < rows[-1]["return"] < 0


def test_the_replays_index_and_reading_are_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(replay, "EPISODES", 2)
    monkeypatch.setattr(replay, "LENGTH", 60)
    monkeypatch.setattr(replay, "SIZE", (8, 10))
    rng = np.random.default_rng(0)
    replay.measure_index(tmp_path / "index", 300, 20, rng)
    replay.measure_reading(tmp_path / "reading", rng)
    said = capsys.readouterr().out
    assert "MiB more than before" in said
    assert "safe_open a draw" in said
