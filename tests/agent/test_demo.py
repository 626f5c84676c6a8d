"""The whole path at the smallest preset, on three floors: stages that run into one another, a report."""

import contextlib
import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from agent.demo import Clock, load_stages, run_demo
from langwm_data.config_io import ConfigError
from langwm_data.scenes import homes
from langwm_data.scenes.splits import BUILDINGS


@contextlib.contextmanager
def silent(unit):
    yield lambda done, total: None


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(homes, "BUILDINGS", {name: BUILDINGS[name] for name in ("Hazel", "Rowan")})
        report = run_demo(out, preset="debug", seed=0, workers=1, fresh=False, progress=silent)
        yield out, report


def test_every_stage_leaves_its_part(demo):
    out, report = demo
    assert report == out / "report.html"
    parts = ("data/dataset.json", "mae/model/model.safetensors", "probe/probe.parquet")
    more = ("agent/model/model.safetensors", "agent/eval/summary.json", "seconds.json")
    assert all((out / part).is_file() for part in (*parts, *more))


def test_report_stands_alone_and_shows_the_numbers_on_disk(demo):
    out, report = demo
    page = report.read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "<script" not in page
    rows = pq.read_table(out / "probe/probe.parquet").to_pylist()
    error = np.mean([row["error_box_m"] for row in rows if row["caption"] == "right"])
    assert f"<td>{error:.3f}</td>" in page
    summary = json.loads((out / "agent/eval/summary.json").read_text())
    systems = {score["system"] for score in summary["scores"]}
    in_order = ["langwm", "random", "straight-ahead", "turn-to-goal", "oracle"]
    assert systems == set(in_order)
    shown = [name for name in re.findall(r"<td>([a-z-]+)</td>", page) if name in systems]
    assert shown == [*in_order, *in_order]  # on test floors and on train floors


def test_the_same_command_goes_on_and_finds_everything_done(demo):
    out, _ = demo
    before = {p: p.stat().st_mtime_ns for p in (out / "data").rglob("*.tar")}
    seconds = json.loads((out / "seconds.json").read_text())
    run_demo(out, preset="debug", seed=0, workers=1, fresh=False, progress=silent)
    assert {p: p.stat().st_mtime_ns for p in (out / "data").rglob("*.tar")} == before
    after = json.loads((out / "seconds.json").read_text())
    assert all(after[stage] >= spent for stage, spent in seconds.items())


def test_another_seed_in_the_same_folder_is_refused(demo):
    out, _ = demo
    with pytest.raises(ConfigError, match=r"seed \(0 there, 1 asked for\); .* or --fresh to start over$"):
        run_demo(out, preset="debug", seed=1, workers=1, fresh=False, progress=silent)


def test_unknown_preset_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ConfigError, match="'huge' is unknown"):
        run_demo(tmp_path / "new", preset="huge", seed=0, workers=1, fresh=False, progress=silent)
    assert not list(tmp_path.iterdir())


def test_stages_read_what_the_one_before_wrote(tmp_path):
    stages = load_stages("tiny", 3, tmp_path)
    assert stages.agent.mae == str(tmp_path / "mae")
    assert stages.dataset.seed == stages.pretrain.seed == stages.agent.seed == 3


def test_clock_adds_up_over_runs(tmp_path):
    (tmp_path / "seconds.json").write_text('{"render": 5.0}')
    clock = Clock(tmp_path / "seconds.json")
    with clock.measure("render"):
        pass
    assert json.loads((tmp_path / "seconds.json").read_text())["render"] >= 5.0
