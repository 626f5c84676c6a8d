"""Only whole checkpoints count; metrics of steps that are taken again are taken back."""

import errno
import json
from pathlib import Path

import pytest
import torch
from full_disk import largest_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from langwm_data.shards.writer import sha256_of
from pretrain.checkpoint import latest_checkpoint, load_checkpoint, save_checkpoint
from pretrain.metrics import MetricsLogger, read_metrics


def state(value):
    return {"weights": {"w": torch.full((2,), float(value))}, "rng": {"state": 2**100, "name": "PCG64"}}


def same(first, second):
    return torch.equal(first["weights"]["w"], second["weights"]["w"])


def test_round_trip(tmp_path):
    folder = save_checkpoint(tmp_path, 7, state(3))
    assert folder.name == "step-000000007"
    step, found = load_checkpoint(folder)
    assert step == 7
    assert torch.equal(found["weights"]["w"], torch.full((2,), 3.0))
    assert found["rng"] == state(3)["rng"]


def test_latest_is_the_last_complete_one(tmp_path):
    assert latest_checkpoint(tmp_path) is None
    save_checkpoint(tmp_path, 9, state(0))
    newest = save_checkpoint(tmp_path, 10, state(1))
    (newest / "done").unlink()
    assert latest_checkpoint(tmp_path).name == "step-000000009"
    save_checkpoint(tmp_path, 10, state(2))
    assert load_checkpoint(latest_checkpoint(tmp_path))[1]["weights"]["w"][0] == 2


def test_older_ones_are_removed(tmp_path):
    for step in range(1, 6):
        save_checkpoint(tmp_path, step, state(step), keep=2)
    names = sorted(path.name for path in (tmp_path / "checkpoints").iterdir())
    assert names == ["step-000000004", "step-000000005"]


def test_a_full_disk_leaves_the_old_checkpoint(tmp_path, monkeypatch):
    save_checkpoint(tmp_path, 1, state(1))

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", fail)
    with pytest.raises(OSError, match="No space left"):
        save_checkpoint(tmp_path, 2, state(2))
    assert latest_checkpoint(tmp_path).name == "step-000000001"


def test_what_the_system_refuses_to_write_leaves_the_old_checkpoint(tmp_path):
    save_checkpoint(tmp_path, 1, {"w": torch.zeros(10)})
    with largest_file(100_000), pytest.raises(OSError, match=r"File too large.*state.pt"):
        save_checkpoint(tmp_path, 2, {"w": torch.zeros(1_000_000)})
    assert latest_checkpoint(tmp_path).name == "step-000000001"
    assert load_checkpoint(latest_checkpoint(tmp_path))[0] == 1


def test_damaged_file_is_refused(tmp_path):
    first, second = (save_checkpoint(tmp_path, step, state(step)) for step in (1, 2))
    for folder, advice in (
        (first, "there is no earlier one; --fresh starts over"),
        (second, "remove its folder to use the one before"),
    ):
        for damaged in (b"", b"not a checkpoint", (folder / "state.pt").read_bytes()[:200]):
            (folder / "state.pt").write_bytes(damaged)
            with pytest.raises(ValueError, match=f"state.pt cannot be read; {advice}"):
                load_checkpoint(folder)


def test_file_that_would_run_code_is_refused(tmp_path):
    folder = save_checkpoint(tmp_path, 1, state(1))

    class Evil:
        def __reduce__(self):
            return (print, ("never",))

    torch.save(Evil(), folder / "state.pt")
    with pytest.raises(ValueError, match=r"state.pt cannot be read"):
        load_checkpoint(folder)


def test_other_schema_version_is_refused(tmp_path):
    folder = save_checkpoint(tmp_path, 1, state(1))
    for other in ({"schema_version": 9, "step": 1, "state": {}}, [1]):
        torch.save(other, folder / "state.pt")
        (folder / "done").write_text(sha256_of(folder / "state.pt"))
        with pytest.raises(ValueError, match=r"has schema version (9|None); this program reads 1"):
            load_checkpoint(folder)


def test_metrics_go_to_lines_and_to_tensorboard(tmp_path):
    with MetricsLogger(tmp_path) as logger:
        logger.log(1, {"mae/depth_loss": 0.5, "perf/images_per_s": float("nan")})
        logger.log(2, {"mae/depth_loss": 0.25})
        logger.close()
    assert read_metrics(tmp_path) == [
        {"step": 1, "mae/depth_loss": 0.5, "perf/images_per_s": None},
        {"step": 2, "mae/depth_loss": 0.25},
    ]
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert [(e.step, e.value) for e in events.Scalars("mae/depth_loss")] == [(1, 0.5), (2, 0.25)]


def test_lines_after_the_step_resumed_from_are_taken_back(tmp_path):
    with MetricsLogger(tmp_path) as logger:
        for step in range(1, 6):
            logger.log(step, {"x": float(step)})
    with (tmp_path / "metrics.jsonl").open("a") as file:
        file.write('{"step": 6, "x"')
    with MetricsLogger(tmp_path, step=3) as logger:
        logger.log(4, {"x": 40.0})
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [(row["step"], row["x"]) for row in lines] == [(1, 1), (2, 2), (3, 3), (4, 40)]
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert [(e.step, e.value) for e in events.Scalars("x")] == [(1, 1.0), (2, 2.0), (3, 3.0), (4, 40.0)]


def test_no_run_no_metrics(tmp_path):
    assert read_metrics(tmp_path) == []


def test_a_flipped_bit_is_refused_where_the_checksum_is_known(tmp_path):
    folder = save_checkpoint(tmp_path, 1, state(1))
    data = bytearray((folder / "state.pt").read_bytes())
    place = data.index(torch.full((2,), 1.0).numpy().tobytes())
    data[place] ^= 1
    (folder / "state.pt").write_bytes(data)
    with pytest.raises(ValueError, match=r"state\.pt cannot be read; there is no earlier one"):
        load_checkpoint(folder)
    (folder / "done").write_text("")  # as it was written before there were checksums
    assert load_checkpoint(folder)[0] == 1


def test_a_step_that_is_saved_again_is_never_without_a_checkpoint(tmp_path, monkeypatch):
    folder = save_checkpoint(tmp_path, 2, state(2), keep=1)

    def full(value, path):
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("pretrain.checkpoint._save", full)
        with pytest.raises(OSError, match="No space left"):
            save_checkpoint(tmp_path, 2, state(3), keep=1)
    assert latest_checkpoint(tmp_path) == folder
    assert same(load_checkpoint(folder)[1], state(2))

    rename = Path.replace

    def killed(source, target):
        if target.name == "state.pt":
            raise KeyboardInterrupt
        return rename(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            save_checkpoint(tmp_path, 2, state(3), keep=1)
    assert len((folder / "done").read_text().split()) == 2
    assert same(load_checkpoint(folder)[1], state(2))
    save_checkpoint(tmp_path, 2, state(3), keep=1)
    assert same(load_checkpoint(folder)[1], state(3))
    assert (folder / "done").read_text() == sha256_of(folder / "state.pt")
