"""Whole evaluations of small untrained agents on the homes."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import cli
from agent import evaluate
from agent.envs.episode_file import make_episode_set, read_episode_file, write_episode_file
from agent.evaluate import Plan, evaluate_agent, evaluate_run, evaluate_runs
from agent.scoring.rows import LOCK_FILE, Journal, claimed, read_rows, task_of
from agent.systems import langwm
from agent.systems.agent import Agent
from agent.systems.controls import make_straight_ahead
from agent.systems.system import Spaces
from langwm_data.config import DatasetConfig, RenderConfig
from langwm_data.config_io import ConfigError, config_to_yaml, load_config
from langwm_data.pipeline import render_dataset

FLOORS = 3


def save_run(folder, config, seed, *, env=None):
    config = dataclasses.replace(config, env=env or config.env, eval_episodes=1)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = langwm.create(dataclasses.replace(config, seed=seed), Spaces(16, 16, 4, 2))
        for weight in model.behavior.parameters():
            weight.data += 0.2 * torch.randn_like(weight)
    Agent(model, langwm.resolve(config, model), Spaces(16, 16, 4, 2)).save_pretrained(folder / "model")
    (folder / "config.yaml").write_text(config_to_yaml(config))
    return folder


@pytest.fixture(scope="module")
def config(tiny_config):
    env = dataclasses.replace(tiny_config.env, render=RenderConfig(texture_px=16), max_steps=6)
    return dataclasses.replace(tiny_config, env=env)


@pytest.fixture
def run(config, tmp_path):
    return save_run(tmp_path / "run", config, 0)


@pytest.fixture(scope="module")
def scored(config, tmp_path_factory):
    """A run, evaluated by one process, with a video."""
    folder = save_run(tmp_path_factory.mktemp("scored") / "run", config, 0)
    return folder, evaluate_runs([folder], Plan(videos=1))


def test_agent_and_controls_play_the_same_episodes(scored):
    folder, summary = scored
    rows = read_rows(folder / "eval")
    assert {r["system"] for r in rows} == {"langwm", "random", "straight-ahead", "turn-to-goal", "oracle"}
    tasks = {}
    for row in rows:
        tasks.setdefault((row["scene"], row["episode"]), set()).add(row["task"])
    assert len(tasks) == FLOORS
    assert all(len(own) == 1 for own in tasks.values())
    assert not (folder / "eval" / ".rows").exists()
    assert [d.second for d in summary.differences] == ["random", "straight-ahead", "turn-to-goal", "oracle"]
    assert "langwm - oracle: success" in summary.as_text()


def test_the_summary_has_the_checksum_of_the_episodes(scored):
    folder, _ = scored
    held = json.loads((folder / "eval" / "summary.json").read_text())
    episodes = read_episode_file(folder / "eval" / "episodes-test.json")
    assert held["episodes"]["test"]["sha256"] == episodes.sha256
    assert held["episodes"]["test"]["counts"] == dict.fromkeys(episodes.scenes, 1)
    assert {(s["tier"], s["scene"]) for s in held["scores"]} >= {(None, None), (0, None), (None, "Maple_0")}


def test_two_processes_give_the_same_rows(scored, config, tmp_path):
    folder = save_run(tmp_path / "run", config, 0)
    seen = []
    evaluate_run(folder, workers=2, progress=lambda done, total: seen.append((done, total)))
    assert read_rows(folder / "eval") == read_rows(scored[0] / "eval")
    assert seen[0] == (0, 5 * FLOORS)
    assert seen[-1] == (5 * FLOORS, 5 * FLOORS)


def test_what_is_scored_is_not_played_again(scored):
    folder, summary = scored
    seen = []
    again = evaluate_run(folder, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(5 * FLOORS, 5 * FLOORS)]
    assert again == summary


def test_pictures_show_the_ways(scored):
    folder, _ = scored
    (video,) = (folder / "eval" / "videos").iterdir()
    film = cv2.VideoCapture(str(video))
    frames = []
    while (read := film.read())[0]:
        frames.append(read[1])
    assert len(frames) == 6 + 10
    assert frames[0].shape[0] == 288
    maps = sorted(path.name for path in (folder / "eval" / "maps").iterdir())
    assert maps == ["test-Maple_0.png", "test-Maple_1.png", "test-Rowan_0.png"]
    assert len(np.unique(cv2.imread(str(folder / "eval" / "maps" / maps[0])).reshape(-1, 3), axis=0)) > 10


class Stopped(Exception):
    pass


def stop_at(count):
    def progress(done, total):
        if done == count:
            raise Stopped

    return progress


def test_a_stopped_evaluation_goes_on(scored, run):
    with pytest.raises(Stopped):
        evaluate_run(run, progress=stop_at(7))
    assert len(Journal(run / "eval").read()) == 7
    journal = next((run / "eval" / ".rows").glob("*.jsonl"))
    journal.write_bytes(journal.read_bytes() + b'{"system": "langwm", "spl')  # what a kill cut off
    seen = []
    evaluate_run(run, progress=lambda done, total: seen.append(done))
    assert seen[0] == 7
    assert read_rows(run / "eval") == read_rows(scored[0] / "eval")


def test_a_killed_evaluation_goes_on(scored, run):
    code = (
        "import os, signal, sys; from agent.evaluate import evaluate_run\n"
        "def progress(done, total):\n"
        "    done == 4 and os.kill(os.getpid(), signal.SIGKILL)\n"
        f"evaluate_run({str(run)!r}, progress=progress)"
    )
    root = Path(cli.__file__).parent
    environment = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, cwd=root, check=False)
    assert done.returncode == -9
    seen = []
    evaluate_run(run, progress=lambda count, total: seen.append(count))
    assert seen[0] == 4
    assert read_rows(run / "eval") == read_rows(scored[0] / "eval")


def test_more_episodes_begin_with_those_that_were_played(run):
    evaluate_run(run, controls=())
    seen = []
    evaluate_run(run, episodes_per_scene=2, controls=(), progress=lambda done, total: seen.append(done))
    assert seen[0] == FLOORS
    assert len(read_rows(run / "eval")) == 2 * FLOORS
    summary = evaluate_run(run, controls=())
    assert summary.scores[0].num_episodes == FLOORS
    assert len(read_rows(run / "eval")) == 2 * FLOORS
    written = json.loads((run / "eval/summary.json").read_text())
    assert set(written["episodes"]["test"]["counts"].values()) == {2}
    assert written["scores"][0]["episodes"] == 2 * FLOORS


def test_an_agent_that_has_learned_since_is_played_again(run, config):
    evaluate_run(run, controls=("oracle",))
    before = read_rows(run / "eval")
    save_run(run, config, 1)
    seen = []
    evaluate_run(run, controls=("oracle",), progress=lambda done, total: seen.append(done))
    assert seen[0] == FLOORS  # the oracle has not
    rows = read_rows(run / "eval")
    assert len(rows) == 2 * FLOORS
    assert [r for r in rows if r["system"] == "oracle"] == [r for r in before if r["system"] == "oracle"]
    assert [r for r in rows if r["system"] == "langwm"] != [r for r in before if r["system"] == "langwm"]


def test_several_runs_in_one_table(run, config, tmp_path):
    other = save_run(tmp_path / "other", config, 1)
    summary = evaluate_runs([run, other], Plan(controls=("oracle",)))
    names = [s.system for s in summary.scores if s.is_overall]
    assert names == [f"langwm {run}", f"langwm {other}", "oracle", "langwm, 2 runs"]
    assert [d.second for d in summary.differences] == [f"langwm {other}", "oracle"]
    for folder in (run, other):
        assert [r["system"] for r in read_rows(folder / "eval")] == ["langwm"] * 3 + ["oracle"] * 3
    assert str(other) in summary.as_text()


def test_a_file_of_episodes_is_what_is_played(run, config, tmp_path):
    path = tmp_path / "episodes.json"
    env = dataclasses.replace(config.env, seed_eval=5)
    write_episode_file(path, make_episode_set(env, "test", 2))
    evaluate_runs([run], Plan(episodes_file=path, controls=()))
    assert len(read_rows(run / "eval")) == 2 * FLOORS
    assert read_episode_file(run / "eval" / "episodes-test.json") == read_episode_file(path)
    with pytest.raises(ValueError, match="3 episodes on Maple_0 are wanted; there are 2"):
        evaluate_runs([run], Plan(episodes_file=path, episodes_per_scene=3))


def test_a_dataset_that_was_moved_is_found_where_it_is_now(run, config, tmp_path, capsys):
    data = tmp_path / "moved"
    frames = {"frames": 2, "camera": {"height": 24, "width": 30}}
    render_dataset(load_config(DatasetConfig, "langwm_data", presets=["debug"], overrides=frames), data)
    scenes = dataclasses.replace(config.env.scenes, baked=str(tmp_path / "gone"))
    save_run(run, config, 0, env=dataclasses.replace(config.env, scenes=scenes))
    assert cli.run(["evaluate-agent", str(run)]) == 2
    assert "no dataset at" in capsys.readouterr().err
    assert cli.run(["evaluate-agent", str(run), "--data", str(data)]) == 0
    assert {row["system"] for row in read_rows(run / "eval")} > {"langwm", "random"}


def test_rows_of_other_episodes_do_not_stay_beside_those_of_a_file(run, config, tmp_path):
    evaluate_run(run, episodes_per_scene=2, controls=("oracle",))
    episodes = make_episode_set(dataclasses.replace(config.env, seed_eval=5), "test", 1)
    write_episode_file(tmp_path / "episodes.json", episodes)
    evaluate_runs([run], Plan(episodes_file=tmp_path / "episodes.json", controls=()))
    rows = read_rows(run / "eval")
    assert [row["task"] for row in rows] == [task_of(e) for e in episodes.episodes]
    written = json.loads((run / "eval/summary.json").read_text())
    assert written["episodes"]["test"]["sha256"] == episodes.sha256
    assert written["scores"][0]["episodes"] == FLOORS


def test_a_policy_of_the_callers_is_scored(config, tmp_path):
    summary = evaluate_agent(
        make_straight_ahead(config.env), env=config.env, episodes_per_scene=1, out=tmp_path
    )
    ours, theirs = (
        [r | {"system": "", "player": ""} for r in read_rows(tmp_path) if r["system"] == name]
        for name in ("agent", "straight-ahead")
    )
    assert ours == theirs
    first = next(d for d in summary.differences if d.second == "straight-ahead")
    assert (first.p_value, first.means["spl"].mean) == (1.0, 0.0)
    assert (
        evaluate_agent(make_straight_ahead(config.env), env=config.env, episodes_per_scene=1).scores
        == summary.scores
    )


def test_refusals_leave_the_folder_alone(run, config, tmp_path):
    fast = dataclasses.replace(config.env, max_linear_m_s=0.7)
    other = save_run(tmp_path / "other", config, 1, env=fast)
    with pytest.raises(ConfigError, match=r"run and .*other drive in different worlds"):
        evaluate_runs([run, other], Plan())
    with pytest.raises(ConfigError, match="none of them twice"):
        evaluate_runs([run, run], Plan())
    with pytest.raises(ConfigError, match="one or more"):
        evaluate_runs([], Plan())
    with pytest.raises(ConfigError, match="device 'abacus' cannot be used on this machine"):
        evaluate_runs([run], Plan(device="abacus"))
    with pytest.raises(ValueError, match="there is no file of episodes at"):
        evaluate_runs([run], Plan(episodes_file=tmp_path / "none.json"))
    assert not (run / "eval").exists()


def test_the_run_of_an_autoencoder_is_refused(run, tiny_mae, tmp_path):
    tiny_mae.save_pretrained(tmp_path / "mae/model")
    (tmp_path / "mae/config.yaml").write_text("steps: 3\nbatch: 4\n")
    with pytest.raises(ValueError, match="holds an autoencoder of pretrain-mae, not a trained agent"):
        evaluate_runs([tmp_path / "mae", run], Plan())


def test_two_processes_at_once_are_refused(run):
    with claimed(run / "eval"), pytest.raises(ValueError, match="another process is scoring into"):
        evaluate_run(run)
    assert [path.name for path in (run / "eval").iterdir()] == [LOCK_FILE]


def test_a_damaged_table_is_named(run):
    (run / "eval").mkdir()
    (run / "eval" / "episodes.parquet").write_bytes(b"no parquet")
    with pytest.raises(ValueError, match=r"episodes.parquet cannot be read: .*remove it to score again"):
        evaluate_run(run)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"split": "attic"}, "--split 'attic' is unknown; allowed: train, test"),
        ({"workers": 0}, "--workers 0.*1 or more workers and episodes"),
        ({"episodes_per_scene": -1}, "--episodes -1.*1 or more workers and episodes"),
        ({"videos": -1}, "--video -1.*0 or more videos"),
        ({"controls": ("ghost",)}, "control 'ghost' is unknown; allowed: random"),
    ],
)
def test_impossible_plans_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        Plan(**change)


def test_the_command_prints_the_table(scored, capsys, monkeypatch):
    folder, _ = scored
    assert cli.run(["evaluate-agent", str(folder), "--workers", "1"]) == 0
    out = capsys.readouterr().out
    assert "langwm" in out
    assert f"rows at {folder / 'eval'}" in out
    monkeypatch.setattr(evaluate, "evaluate_runs", lambda *a, **k: 1 / 0)
    assert cli.run(["evaluate-agent", str(folder), "--split", "attic"]) == 2
    assert "--split 'attic' is unknown" in capsys.readouterr().err
