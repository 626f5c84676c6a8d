"""What the proofs that take minutes are made of, in seconds: kills, memory, and random damage."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import combinations, forks, fuzz, kills, memory
from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.shards.manifest import CARD_FILE

SMALL = {"camera": {"height": 16, "width": 20}, "render": {"texture_px": 16}}


def test_a_job_that_is_killed_gives_the_bytes_of_one_that_is_not(tmp_path):
    flags = [
        "--kills",
        "2",
        "--frames",
        "24",
        "--samples-per-shard",
        "4",
        "--ways",
        "killed",
        "--workers",
        "1",
    ]
    for setting in (
        "camera.height=16",
        "camera.width=20",
        "render.texture_px=16",
        "cameras.frames_per_palette=8",
    ):
        flags += ["--set", setting]
    command = [sys.executable, kills.__file__, "--out", str(tmp_path / "out"), *flags]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": "."}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert sum(line.startswith("kill ") for line in lines) == 2
    assert any(re.fullmatch(r"killed 2 times in \d jobs?: identical", line) for line in lines)
    assert lines[-2:] == ["sound: 24 frames in 7 shards", "one dataset, byte for byte"]


def test_folders_that_differ_are_named(tmp_path):
    for name, text in (("a", "1"), ("b", "2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "same").write_text("x")
        (tmp_path / name / "file").write_text(text)
    (tmp_path / "b/more").write_text("")
    assert kills.differences(tmp_path / "a", tmp_path / "b") == ["file", "more"]
    assert kills.differences(tmp_path / "a", tmp_path / "a") == []


def test_memory_is_that_of_a_process_and_its_children():
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'x = bytes(50 << 20); input()'])"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE) as process:
        sizes = []
        while len(memory.descendants(process.pid)) < 2 or sizes[-2:-1] != sizes[-1:]:
            sizes.append(sum(map(memory.pss_bytes, memory.descendants(process.pid))))
        alone = memory.pss_bytes(process.pid)
        process.communicate(b"\n")
    assert sizes[-1] > alone > 0
    assert memory.pss_bytes(process.pid) == 0


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Ten frames of drives under lights of their own, in four shards. Who damages it undoes that."""
    values = SMALL | {
        "frames": 10,
        "seed": 3,
        "splits": {"test_fraction": 0.2},
        "cameras": {"mode": "trajectory", "frames_per_palette": 8, "trajectory_length": 4},
        "randomize": {"lights": "block"},
        "shards": {"samples_per_shard": 3},
    }
    return render_dataset(build_config(DatasetConfig, values), tmp_path_factory.mktemp("fuzz") / "dataset")


def test_a_bit_flipped_anywhere_is_found_or_harmless(drive):
    attempts = list(fuzz.flip_bits(drive, np.random.default_rng(0), 22))
    missed = [a for a in attempts if not a.is_found and not fuzz.is_harmless(drive, a)]
    assert missed == []
    assert len({a.file for a in attempts}) == 11
    assert sum(a.is_found for a in attempts) >= 20


@pytest.mark.parametrize("with_index", [False, True], ids=["checksums fit", "index fits too"])
def test_any_value_of_a_document_that_is_changed_is_found(drive, tmp_path, with_index):
    folder = shutil.copytree(drive, tmp_path / "dataset")
    key = fuzz.read_files(folder / "train/train-000000.tar")[5][0].partition(".")[0]
    rng = np.random.default_rng(0)
    attempts = list(
        fuzz.change_documents(
            folder, rng, shard="train/train-000000.tar", key=key, with_index=with_index, every=25
        )
    )
    assert len(attempts) > 10
    assert [a for a in attempts if not a.is_found] == []


def test_words_of_the_card_alone_are_harmless(drive):
    size = (drive / CARD_FILE).stat().st_size
    in_words = fuzz.Attempt(file=CARD_FILE, what=f"byte {size - 1}, bit 0", said=())
    assert fuzz.is_harmless(drive, in_words)
    assert not fuzz.is_harmless(drive, fuzz.Attempt(file=CARD_FILE, what="byte 10, bit 0", said=()))


def test_a_pretraining_run_that_is_killed_learns_what_an_undisturbed_one_learns(tmp_path):
    data = build_config(DatasetConfig, {"frames": 8, **SMALL, "camera": {"height": 32, "width": 48}})
    flags = ["--data", str(render_dataset(data, tmp_path / "data")), "--kills", "1", "--steps", "6"]
    for setting in ("mae.height=32", "mae.width=48", "checkpoint_every=2", "valid_every=6"):
        flags += ["--set", setting]
    command = [sys.executable, "-m", "benchmarks.pretrain_kills", "--out", str(tmp_path / "out"), *flags]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": "."}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert re.fullmatch(r"kill   1 at step \d", lines[1])
    assert lines[-2:] == ["6 logged steps: equal", "weights: equal"]


def test_a_run_that_learned_something_else_is_told_apart(tmp_path):
    for name, loss in (("a", 1.0), ("b", 1.5)):
        (tmp_path / name).mkdir()
        row = {"step": 1, "mae/depth_loss": loss, "perf/images_per_s": 10 * loss}
        (tmp_path / name / "metrics.jsonl").write_text(json.dumps(row) + "\n")
    learned = [forks.learned(tmp_path / name, except_for="perf/") for name in "ab"]
    assert learned[0] == [{"step": 1, "mae/depth_loss": 1.0}]
    assert learned[0] != learned[1]
    assert forks.last_step(tmp_path / "a") == 1
    assert forks.last_step(tmp_path) == 0


def test_combinations_differ_in_their_switches_alone():
    options = SimpleNamespace(steps=3, seed=0, preset="homes", set=[])
    configs = {name: combinations.config_of(name, options) for name in combinations.COMBINATIONS}
    switches = {n: (c.objects.hides, c.objects.captions, c.mae.target) for n, c in configs.items()}
    assert switches == {
        "grounded": (True, "chosen", "depth"),
        "masks": (True, "none", "depth"),
        "language": (False, "chosen", "depth"),
        "neither": (False, "none", "depth"),
        "voltron": (False, "scene", "depth"),
        "mwm": (False, "none", "rgb"),
    }
    alike = {
        replace(c, objects=configs["grounded"].objects, mae=configs["grounded"].mae) for c in configs.values()
    }
    assert len(alike) == 1
    assert {replace(c.mae, target="depth") for c in configs.values()} == {configs["grounded"].mae}


def test_combinations_are_trained_and_asked_the_same(tmp_path, monkeypatch):
    data = build_config(
        DatasetConfig, {"frames": 24, **SMALL, "camera": {"height": 32, "width": 48}, "seed": 1}
    )
    command = ["combinations", "--out", str(tmp_path / "out")]
    command += ["--data", str(render_dataset(data, tmp_path / "data")), "--preset", "debug"]
    command += ["--steps", "2", "--frames", "4", "--only", "masks", "mwm"]
    for setting in ("mae.height=32", "mae.width=48", "valid_every=2"):
        command += ["--set", setting]
    monkeypatch.setattr(sys, "argv", command)
    combinations.main()
    rows = [line for line in (tmp_path / "out/combinations.md").read_text().splitlines() if "|" in line]
    assert [row.split("|")[1].strip() for row in rows[2:]] == [
        "object masks",
        "colours, as MWM",
        "random encoder",
        "raw frame",
        "without looking",
    ]
    errors = json.loads((tmp_path / "out/combinations.json").read_text())["depth"]["masks"]["captions"][
        "empty"
    ]["error_m"]
    assert (
        rows[2].split("|")[3].strip() == f"{errors['mean']:.3f} [{errors['low']:.3f}, {errors['high']:.3f}]"
    )
    assert not rows[3].split("|")[3].strip()


def test_an_updates_parts_add_up_to_the_whole(tmp_path):
    flags = ["--only", "vector", "--preset", "debug", "--rounds", "2", "--threads", "1"]
    files = ["--json", str(tmp_path / "speed.json"), "--markdown", str(tmp_path / "speed.md")]
    script = pathlib.Path(kills.__file__).with_name("agent.py")
    done = subprocess.run(
        [sys.executable, str(script), *flags, *files], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "speed.json").read_text())
    rows = {row["part"]: row for row in found["updates"]["vector"]["rows"]}
    whole = rows.pop("whole update")
    assert {"replay: 16 x 50 steps read", "world model", "behaviour"} <= rows.keys()
    assert sum(row["gflop"] for row in rows.values()) == pytest.approx(whole["gflop"])
    assert whole["gflop"] > 0
    assert all(r["wall_s_low"] <= r["wall_s"] <= r["wall_s_high"] for r in rows.values())
    assert found["updates"]["vector"]["peak_mib"] > 50
    assert found["matmul_gflops"]["fp32"] > 0
    assert "| behaviour |" in (tmp_path / "speed.md").read_text()
