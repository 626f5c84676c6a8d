"""The benchmarks of stage three, in seconds."""

import numpy as np

from benchmarks import replay


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
