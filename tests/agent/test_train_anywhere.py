"""Training in an environment that is not this project's, what of it goes wrong, and what is kept then."""

import dataclasses
import errno
import os

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from agent.best import WINDOW, Best
from agent.envs.outcomes import Outcome
from agent.plan import plan_training
from agent.systems.agent import Agent
from agent.systems.registry import load_agent_config
from agent.train import train_agent
from langwm_data.config_io import ConfigError
from pretrain.checkpoint import latest_checkpoint, load_checkpoint
from pretrain.metrics import MetricsLogger, read_metrics

SIZE = 16


class Drift(gymnasium.Env):
    """A bar that the action moves sideways; its place has to be seen, and is rewarded in the middle."""

    observation_space = spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8)
    action_space = spaces.Box(-3.0, 3.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = int(self.np_random.integers(SIZE))
        return self.observe(), {}

    def step(self, action):
        self.place = int(np.clip(self.place + round(float(action[0])), 0, SIZE - 1))
        return self.observe(), -abs(self.place - SIZE / 2) / SIZE, False, False, {}

    def observe(self):
        frame = np.zeros((SIZE, SIZE, 3), np.uint8)
        frame[:, self.place] = 255
        return frame


gymnasium.register("Tests/Drift-v0", entry_point=Drift, max_episode_steps=6)


@pytest.fixture(scope="module")
def config(tiny_config):
    env = dataclasses.replace(tiny_config.env, id="Tests/Drift-v0")
    return dataclasses.replace(tiny_config, env=env, system="dreamerv2")


def logged(run):
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(run)]


def kill_at(step):
    def progress(done, total):
        if done == step:
            raise RuntimeError("killed")

    return progress


@pytest.mark.parametrize("system", ["dreamerv2", "curl", "mwm"])
def test_systems_learn_in_any_env_and_go_on_after_a_kill(system, config, tmp_path):
    changes = {}
    if system == "mwm":
        objects = dataclasses.replace(config.finetune.objects, hides=False, captions="none")
        model = dataclasses.replace(config.finetune.model, target="rgb")
        changes["finetune"] = dataclasses.replace(config.finetune, objects=objects, model=model)
    config = dataclasses.replace(config, system=system, **changes)
    whole = train_agent(config, tmp_path / "whole")
    rows = read_metrics(whole)
    assert any("env/return" in row and "env/spl" not in row and "env/success" not in row for row in rows)
    assert all(np.isfinite(v) for row in rows for v in row.values())
    with pytest.raises(RuntimeError, match="killed"):
        train_agent(config, tmp_path / "killed", progress=kill_at(47))
    train_agent(config, tmp_path / "killed")
    assert logged(tmp_path / "killed") == logged(whole)
    agent = Agent.from_pretrained(whole)
    assert agent.env.id == "Tests/Drift-v0"
    obs = {"rgb": np.zeros((SIZE, SIZE, 3), np.uint8), "task": np.zeros(1, np.float32)}
    assert agent.act(obs)[0].shape == (1,)


def test_an_env_in_python_is_taken_as_one_by_name_is(config, tmp_path):
    by_name = train_agent(config, tmp_path / "name")
    elsewhere = dataclasses.replace(config, env=dataclasses.replace(config.env, id=None))
    given = train_agent(elsewhere, tmp_path / "given", env=gymnasium.make("Tests/Drift-v0"))
    assert logged(by_name) == logged(given)


def test_the_random_beginning_differs_between_episodes_that_look_alike(config, tmp_path):
    run = train_agent(dataclasses.replace(config, steps=24), tmp_path / "run")
    _, state = load_checkpoint(latest_checkpoint(run))
    from agent.replay import Replay

    replay = Replay(config.replay, run / "replay", state["replay"])
    drawn = replay.sample(np.random.default_rng(0), 4, 6).action
    assert len({tuple(row[1:, 0].tolist()) for row in drawn}) > 1


@pytest.mark.parametrize(
    ("system", "needs"),
    [
        ("langwm", "depth in its observation and objects in its info"),
        ("dreamerv2-oracle-boxes", "objects in its info"),
    ],
)
def test_a_system_that_needs_labels_is_refused_before_anything_is_written(config, tmp_path, system, needs):
    overrides = dataclasses.asdict(config)
    del overrides["env"]["with_labels"]  # as the system's own configuration has it
    with pytest.raises(ConfigError, match=f"{system!r} is to be given {needs}, which"):
        train_agent(load_agent_config(system, overrides=overrides), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def whole(config, tmp_path_factory):
    """A run that nothing disturbed, and its configuration."""
    config = dataclasses.replace(config, steps=200)
    return config, train_agent(config, tmp_path_factory.mktemp("whole") / "run")


@pytest.mark.parametrize("part", ["best", "model", "checkpoints", "metrics.jsonl"])
def test_a_full_disk_anywhere_leaves_the_last_checkpoint(part, whole, tmp_path, monkeypatch):
    config, undisturbed = whole
    out = tmp_path / "full"
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), part)
    with monkeypatch.context() as patch:
        refuse_after(patch, part, full)
        with pytest.raises(OSError, match="No space left on device"):
            train_agent(config, out)
    kept = latest_checkpoint(out)
    assert kept is not None
    load_checkpoint(kept)
    train_agent(config, out)
    assert logged(out) == logged(undisturbed)
    ours, theirs = (Agent.from_pretrained(run).model.state_dict() for run in (out, undisturbed))
    assert all(np.array_equal(ours[k], theirs[k]) for k in theirs)


def refuse_after(patch, part, error):
    """Let the disk be full for ``part`` from the second third of the run on."""
    if part == "metrics.jsonl":
        log = MetricsLogger.log

        def refuse_log(self, step, values):
            if step > 90:
                raise error
            log(self, step, values)

        patch.setattr(MetricsLogger, "log", refuse_log)
        return
    if part == "checkpoints":
        from pretrain import checkpoint

        save = checkpoint._save

        def refuse_save(value, path):
            if value["step"] > 90:
                raise error
            save(value, path)

        patch.setattr(checkpoint, "_save", refuse_save)
        return
    write, count = Agent.save_pretrained, [0]

    def refuse_weights(self, folder):
        count[0] += folder.name == part
        if folder.name == part and (part == "best" or count[0] > 3):
            raise error
        write(self, folder)

    patch.setattr(Agent, "save_pretrained", refuse_weights)


def test_the_best_agent_is_kept_beside_the_last(config, tmp_path):
    run = train_agent(dataclasses.replace(config, steps=200), tmp_path / "run")
    best = Agent.from_pretrained(run / "best")
    assert best.system == "dreamerv2"


class Paper(Agent):
    """Counts in place of an agent."""

    def __init__(self):
        self.saved = 0

    def save_pretrained(self, folder):
        self.saved += 1


def outcome(total, success=None):
    return Outcome(num_steps=1, total_reward=total, success=success, is_terminated=True)


def test_best_is_by_success_then_by_return_over_a_full_window(tmp_path):
    best, agent = Best(tmp_path), Paper()
    for _ in range(WINDOW - 1):
        best.add(outcome(5.0, success=False))
    best.keep(agent)
    assert agent.saved == 0
    best.add(outcome(5.0, success=False))
    best.keep(agent)
    best.keep(agent)
    assert agent.saved == 1
    best.add(outcome(0.0, success=True))  # a worse return but one more success
    best = Best(tmp_path, best.state_dict())
    best.keep(agent)
    assert agent.saved == 2
    for _ in range(WINDOW):
        best.add(outcome(90.0, success=False))
    best.keep(agent)
    assert agent.saved == 2


def test_a_plan_says_what_a_run_will_take_and_writes_nothing(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = plan_training(dataclasses.replace(config, steps=100_000, prefill_steps=5000, update_every=5))
    assert plan.updates == 19_000
    assert plan.held_steps == 100_000
    assert plan.bytes_per_step > SIZE * SIZE * 3
    assert plan.hours == pytest.approx(
        (1e5 * plan.seconds_per_step + 19_000 * plan.seconds_per_update) / 3600
    )
    text = plan.as_text()
    assert "steps   100,000 of the environment" in text
    assert "updates 19,000, " in text
    assert not list(tmp_path.iterdir())
