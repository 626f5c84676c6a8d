"""The benchmarks of stage three, in seconds."""

import json

import numpy as np
import pytest

from benchmarks import learning, replay


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


@pytest.mark.parametrize(
    ("task", "system"),
    [("reach-boxes", "dreamerv2-oracle-boxes"), ("line", "dreamerv2-da"), ("reach", "langwm")],
)
def test_a_learning_proof_scores_what_it_trained_beside_chance(task, system, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(learning, "EPISODES", 2)
    short = ["prefill_steps=60", "checkpoint_every=50", "log_every=1"]
    request = ["learning", "--system", system, "--task", task, "--steps", "70", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", [*request, *(f"--set={text}" for text in short)])
    learning.main()
    by_chance, learned = json.loads((tmp_path / task / "learning.json").read_text())
    assert (by_chance["system"], learned["system"]) == ("random", system)
    assert learned["updates"] > 0
    assert learned["return"][1] <= learned["return"][0] <= learned["return"][2]
    assert f"| {system} |" in capsys.readouterr().out
    assert (tmp_path / task / "curve.png").stat().st_size > 0
