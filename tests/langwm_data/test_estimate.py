import dataclasses

import pytest

from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.estimate import estimate

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 24,
        "camera": {"height": 48, "width": 60},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "cameras": {"frames_per_palette": 12},
        "shards": {"samples_per_shard": 10},
    },
)


@pytest.fixture(scope="module")
def plan():
    return estimate(CONFIG, workers=2)


def test_disk_is_foretold_within_a_fifth(plan, tmp_path):
    out = render_dataset(CONFIG, tmp_path / "out")
    written = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    assert plan.disk_bytes == pytest.approx(written, rel=0.2)
    assert (plan.frames, plan.shards, plan.floors) == (24, 3, 2)


def test_time_and_memory_follow_from_what_was_measured(plan):
    alone = dataclasses.replace(plan, workers=1)
    assert alone.hours == pytest.approx(2 * plan.hours)
    assert 2 * alone.memory_bytes == plan.memory_bytes
    work_s = 24 * plan.seconds_per_frame + 2 * plan.seconds_per_floor
    assert alone.hours * 3600 == pytest.approx(work_s)
    assert 0 < plan.seconds_per_frame < plan.seconds_per_floor
    assert plan.worker_bytes > 50e6


def test_a_plan_is_text_of_one_line_each(plan):
    text = plan.as_text()
    assert [line.split()[0] for line in text.splitlines()] == ["frames", "disk", "memory", "time", "measured"]
    assert "24 in 3 shards, of 2 floors" in text


@pytest.mark.parametrize(
    ("frames", "said"),
    [(1000, "10 seconds with 1 worker of"), (100_000, "17 minutes with"), (10_000_000, "27.8 hours with")],
)
def test_times_are_said_in_units_that_fit(plan, frames, said):
    values = {"frames": frames, "workers": 1, "seconds_per_frame": 0.01, "seconds_per_floor": 0.1}
    assert f"time    {said}" in dataclasses.replace(plan, **values).as_text()


def test_a_range_is_planned_alone():
    part = estimate(CONFIG, shards=range(2, 9))
    assert (part.frames, part.shards, part.floors) == (4, 1, 1)
