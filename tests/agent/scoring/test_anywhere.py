import dataclasses
import json

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest
from gymnasium import spaces

from agent.evaluate import Plan, evaluate_runs
from agent.scoring.anywhere import evaluate_anywhere, is_elsewhere
from agent.train import train_agent
from langwm_data.config_io import ConfigError


class Grey(gymnasium.Env):
    """Five steps; the reward is the action, drawn shades tell nothing."""

    observation_space = spaces.Box(0, 255, (16, 16, 3), np.uint8)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.shade = int(self.np_random.integers(255))
        return np.full((16, 16, 3), self.shade, np.uint8), {}

    def step(self, action):
        return np.full((16, 16, 3), self.shade, np.uint8), float(action[0]), False, False, {}


gymnasium.register("Tests/Grey-v0", entry_point=Grey, max_episode_steps=5)


@pytest.fixture(scope="module")
def run(tiny_config, tmp_path_factory):
    env = dataclasses.replace(tiny_config.env, id="Tests/Grey-v0")
    config = dataclasses.replace(tiny_config, env=env, system="dreamerv2", steps=30)
    return train_agent(config, tmp_path_factory.mktemp("runs") / "grey")


def test_an_agent_is_scored_beside_random_where_it_learned(run):
    calls = []
    summary = evaluate_anywhere(run, episodes=4, progress=lambda *call: calls.append(call))
    agent, wander = summary.scores
    assert (agent.system, wander.system) == ("dreamerv2", "random")
    assert agent.success is None
    assert agent.length.mean == 5
    assert "not known" in summary.as_text()
    assert calls[-1] == (8, 8)
    rows = pq.read_table(run / "eval" / "episodes.parquet").to_pylist()
    ours = [row["return"] for row in rows if row["system"] == "dreamerv2"]
    assert agent.total_reward.mean == pytest.approx(np.mean(ours))
    assert len({row["return"] for row in rows if row["system"] == "random"}) == 4
    scores = json.loads((run / "eval" / "summary.json").read_text())["scores"]
    assert scores[0]["num_episodes"] == 4
    assert evaluate_anywhere(run, episodes=4) == summary


def test_a_device_that_is_not_there_is_refused(run):
    with pytest.raises(ConfigError, match="device 'abacus' cannot be used on this machine"):
        evaluate_anywhere(run, device="abacus")


def test_fixed_episodes_are_refused_elsewhere(run):
    assert is_elsewhere(run)
    with pytest.raises(ConfigError, match=r"learned in env 'Tests/Grey-v0', which has no fixed episodes"):
        evaluate_runs([run], Plan())


def test_what_a_run_names_is_not_imported(run, tmp_path):
    model = tmp_path / "model"
    model.mkdir()
    for path in (run / "model").iterdir():
        (model / path.name).write_bytes(path.read_bytes())
    held = json.loads((model / "config.json").read_text())
    held["config"]["env"]["id"] = "this:Grey-v0"
    (model / "config.json").write_text(json.dumps(held))
    with pytest.raises(
        ConfigError, match=r"names env\.id 'this:Grey-v0', and what a run names is not imported"
    ):
        evaluate_anywhere(tmp_path)
    assert evaluate_anywhere(tmp_path, env=gymnasium.make("Tests/Grey-v0"), episodes=1)
