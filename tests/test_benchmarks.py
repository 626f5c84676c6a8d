"""What the proofs that take minutes are made of, in seconds: kills, memory, and random damage."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import fuzz, kills, memory
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
