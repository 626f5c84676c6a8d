import dataclasses
import errno
import os
import shutil
import signal

import gymnasium
import numpy as np
import pytest

from agent.config import AgentConfig
from agent.replay.files import write_episode
from agent.systems.agent import Agent
from agent.systems.finetune import Finetuner
from agent.train import train_agent
from langwm_data.config import CameraConfig
from langwm_data.config_io import ConfigError, load_config_file
from pretrain.checkpoint import latest_checkpoint, load_checkpoint, save_checkpoint
from pretrain.metrics import read_metrics


def losses(run):
    """Logged rows without what depends on the clock."""
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(run)]


class Killed(Exception):
    pass


def kill_at(step):
    def progress(done, total):
        if done == step:
            raise Killed

    return progress


@pytest.fixture(scope="module")
def whole_run(tiny_config, make_room, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "whole"
    return train_agent(tiny_config, out, env=make_room(max_steps=9))


def test_run_learns_logs_and_hands_on_an_agent(whole_run, make_room):
    rows = read_metrics(whole_run)
    assert any("env/success" in row for row in rows)
    trained = [row for row in rows if "wm/loss" in row]
    assert {"mae/depth_loss", "wm/kl", "behavior/imagined_return"} <= trained[-1].keys()
    assert all(np.isfinite(v) for row in rows for v in row.values())
    agent = Agent.from_pretrained(whole_run)
    obs, _ = make_room().reset(seed=0)
    assert agent.act(obs)[0].shape == (2,)


@pytest.mark.parametrize("step", [12, 33, 47])
def test_a_killed_run_goes_on_with_the_same_numbers(step, whole_run, tiny_config, make_room, tmp_path):
    out = tmp_path / "killed"
    with pytest.raises(Killed):
        train_agent(tiny_config, out, env=make_room(max_steps=9), progress=kill_at(step))
    train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert losses(out) == losses(whole_run)
    ours, theirs = (Agent.from_pretrained(run).model.state_dict() for run in (out, whole_run))
    assert all(np.array_equal(ours[k], theirs[k]) for k in theirs)


def test_a_longer_run_goes_on_from_a_shorter_one(whole_run, tiny_config, make_room, tmp_path):
    short = dataclasses.replace(tiny_config, steps=43)
    train_agent(short, tmp_path / "short", env=make_room(max_steps=9))
    train_agent(tiny_config, tmp_path / "short", env=make_room(max_steps=9))
    assert losses(tmp_path / "short") == losses(whole_run)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_saves_first(number, whole_run, tiny_config, make_room, tmp_path):
    def interrupt(done, total):
        if done == 33:
            os.kill(os.getpid(), number)

    out = tmp_path / "interrupted"
    with pytest.raises(KeyboardInterrupt):
        train_agent(tiny_config, out, env=make_room(max_steps=9), progress=interrupt)
    assert latest_checkpoint(out).name == "step-000000033"
    train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert losses(out) == losses(whole_run)


def test_every_state_is_saved_once_also_before_and_after_the_autoencoder_is_pretrained(
    tiny_config, make_room, tmp_path, monkeypatch
):
    saved = []

    def note(run, step, state, **options):
        saved.append((step, state["learner"]["finetuner"]["num_updates"]))
        return save_checkpoint(run, step, state, **options)

    monkeypatch.setattr("agent.train.save_checkpoint", note)
    train_agent(tiny_config, tmp_path / "run", env=make_room(max_steps=9))
    assert len(set(saved)) == len(saved)
    assert [step for step, _ in saved] == [20, 25, 25, 40, 60]
    assert [updates for _, updates in saved[:3]] == [0, 0, tiny_config.finetune.pretrain_updates]


def test_a_run_killed_while_its_autoencoder_is_pretrained_goes_on_from_the_end_of_the_prefill(
    whole_run, tiny_config, make_room, tmp_path, monkeypatch
):
    out, learn = tmp_path / "killed", Finetuner.update

    def kill(self, frames):
        if self.num_updates == 2:
            raise Killed
        return learn(self, frames)

    with monkeypatch.context() as patch:
        patch.setattr(Finetuner, "update", kill)
        with pytest.raises(Killed):
            train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert latest_checkpoint(out).name == "step-000000025"
    train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert losses(out) == losses(whole_run)


def test_a_finished_run_does_nothing(whole_run, tiny_config, make_room, caplog):
    before = (whole_run / "metrics.jsonl").stat().st_mtime_ns
    with caplog.at_level("INFO"):
        train_agent(tiny_config, whole_run, env=make_room(max_steps=9))
    assert "has taken 60 steps already" in caplog.text
    assert (whole_run / "metrics.jsonl").stat().st_mtime_ns == before


@pytest.mark.parametrize(("steps", "is_warned"), [(24, True), (25, False)])
def test_a_run_too_short_to_learn_says_so(steps, is_warned, tiny_config, make_room, tmp_path, caplog):
    config = dataclasses.replace(tiny_config, system="dreamerv2", steps=steps)
    train_agent(config, tmp_path / "run", env=make_room(max_steps=9))
    said = f"learned nothing: {steps} steps are over before the first update, with prefill_steps 25"
    assert (said in caplog.text) == is_warned
    _, state = load_checkpoint(latest_checkpoint(tmp_path / "run"))
    assert (state["num_updates"] == 0) == is_warned


def test_fewer_steps_than_are_taken_change_nothing(whole_run, tiny_config, make_room, caplog):
    before = (whole_run / "config.yaml").read_text()
    with caplog.at_level("INFO"):
        train_agent(dataclasses.replace(tiny_config, steps=43), whole_run, env=make_room(max_steps=9))
    assert "has taken 60 steps already" in caplog.text
    assert (whole_run / "config.yaml").read_text() == before


class Barred(gymnasium.Wrapper):
    """An environment that says only at the start of an episode that there is none."""

    def reset(self, **_):
        raise ConfigError("no such goals")


def test_an_environment_that_cannot_begin_leaves_no_folder(tiny_config, make_room, tmp_path):
    with pytest.raises(ConfigError, match="no such goals"):
        train_agent(tiny_config, tmp_path / "run", env=Barred(make_room()))
    assert not (tmp_path / "run").exists()


def test_an_environment_that_cannot_begin_costs_no_run_that_was_there(
    whole_run, tiny_config, make_room, tmp_path
):
    out = shutil.copytree(whole_run, tmp_path / "run")
    with pytest.raises(ConfigError, match="no such goals"):
        train_agent(tiny_config, out, fresh=True, env=Barred(make_room()))
    assert losses(out) == losses(whole_run)
    assert latest_checkpoint(out).name == "step-000000060"


def test_fresh_removes_a_whole_run_with_its_scores_and_nothing_else(
    whole_run, tiny_config, make_room, tmp_path
):
    out = shutil.copytree(whole_run, tmp_path / "run")
    (out / "eval").mkdir()
    (out / "data").mkdir()
    other = dataclasses.replace(tiny_config, steps=1, seed=1)
    with pytest.raises(ConfigError, match=r"--fresh would remove '.*/run/data', which this command does not"):
        train_agent(other, out, fresh=True, env=make_room(max_steps=9))
    assert latest_checkpoint(out).name == "step-000000060"
    (out / "data").rmdir()
    train_agent(other, out, fresh=True, env=make_room(max_steps=9))
    assert latest_checkpoint(out).name == "step-000000001"
    assert not (out / "eval").exists()


def test_another_configuration_in_the_same_place_is_refused(whole_run, tiny_config):
    with pytest.raises(ConfigError, match="batch_size"):
        train_agent(dataclasses.replace(tiny_config, batch_size=2), whole_run)


def test_a_run_that_names_its_dataset_relatively_goes_on_when_it_is_named_from_the_root(
    tiny_config, make_room, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    for steps, baked in ((10, "data"), (20, str(tmp_path / "data"))):
        scenes = dataclasses.replace(tiny_config.env.scenes, baked=baked)
        env = dataclasses.replace(tiny_config.env, scenes=scenes)
        config = dataclasses.replace(tiny_config, steps=steps, env=env)
        train_agent(config, tmp_path / "run", env=make_room(max_steps=9))
    held = load_config_file(AgentConfig, tmp_path / "run/config.yaml")
    assert (held.steps, held.env.scenes.baked) == (20, str(tmp_path / "data"))


def test_frozen_features_come_from_a_pretrained_mae_and_stay(tiny_config, tiny_mae, make_room, tmp_path):
    tiny_mae.save_pretrained(tmp_path / "mae" / "model")
    config = dataclasses.replace(tiny_config, features="frozen", mae=str(tmp_path / "mae"))
    run = train_agent(config, tmp_path / "run", env=make_room(max_steps=9))
    ours = Agent.from_pretrained(run).model.perception.mae.state_dict()
    assert all(np.array_equal(ours[k], v) for k, v in tiny_mae.state_dict().items())
    assert not any("mae/depth_loss" in row for row in read_metrics(run))


def test_frozen_features_without_a_mae_are_refused(tiny_config, tmp_path):
    with pytest.raises(ConfigError, match="features 'frozen' needs a pretrained MAE"):
        train_agent(dataclasses.replace(tiny_config, features="frozen"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_missing_mae_is_refused(tiny_config, tmp_path):
    config = dataclasses.replace(tiny_config, mae=str(tmp_path))
    with pytest.raises(ValueError, match="holds no pretrained autoencoder"):
        train_agent(config, tmp_path / "run")


def test_a_camera_that_does_not_fit_the_mae_is_refused(tiny_config, tmp_path):
    camera = CameraConfig(height=32, width=32)
    config = dataclasses.replace(tiny_config, env=dataclasses.replace(tiny_config.env, camera=camera))
    with pytest.raises(ConfigError, match=r"32 x 32 pixels but the MAE reads 16 x 16"):
        train_agent(config, tmp_path / "run")


def test_a_task_observation_of_another_size_is_refused(tiny_config, make_room, tmp_path):
    task = dataclasses.replace(tiny_config.world_model.task, scale=(1.0, 1.0))
    world_model = dataclasses.replace(tiny_config.world_model, task=task)
    with pytest.raises(ConfigError, match=r"task\.scale has 2 entries"):
        train_agent(
            dataclasses.replace(tiny_config, world_model=world_model), tmp_path / "run", env=make_room()
        )


def test_an_unknown_device_is_refused(tiny_config, tmp_path):
    with pytest.raises(ConfigError, match="device 'abacus' cannot be used"):
        train_agent(dataclasses.replace(tiny_config, device="abacus"), tmp_path / "run")


def test_a_full_disk_stops_a_run_with_its_last_checkpoint_intact(
    whole_run, tiny_config, make_room, tmp_path, monkeypatch
):
    out = tmp_path / "full"

    def write(path, episode):
        if path.name == "episode-00000004.safetensors":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return write_episode(path, episode)

    with monkeypatch.context() as patch:
        patch.setattr("agent.replay.buffer.write_episode", write)
        with pytest.raises(OSError, match="No space left on device"):
            train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert latest_checkpoint(out).name == "step-000000040"
    obs, _ = make_room().reset(seed=0)
    assert Agent.from_pretrained(out).act(obs)[0].shape == (2,)
    train_agent(tiny_config, out, env=make_room(max_steps=9))
    assert losses(out) == losses(whole_run)


def test_a_disk_too_small_is_refused_before_anything_is_written(tiny_config, make_room, tmp_path):
    config = dataclasses.replace(
        tiny_config, steps=10**15, replay=dataclasses.replace(tiny_config.replay, capacity_steps=10**15)
    )
    with pytest.raises(
        ConfigError, match=r"replay.capacity_steps: 1000000000000000 steps of 1988 bytes take"
    ):
        train_agent(config, tmp_path / "run", env=make_room())
    assert not (tmp_path / "run").exists()
