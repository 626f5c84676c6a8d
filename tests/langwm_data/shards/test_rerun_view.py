"""Frames in the Rerun viewer; what is logged is read back with Rerun's own reader where it is installed."""

import sys

import pytest

from langwm_data import ShardDataset
from langwm_data.config_io import ConfigError
from langwm_data.shards.rerun_view import show_frames


def test_a_missing_sdk_is_one_sentence(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"--rerun needs the Rerun SDK: pip install 'langwm\[rerun\]'"):
        show_frames(ShardDataset(folder))


def test_a_recording_holds_every_image_of_every_frame(folder, tmp_path):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    out = tmp_path / "new" / "frames.rrd"
    show_frames(ShardDataset(folder).select(split="test"), out)
    rows = {}
    for chunk in reader(out).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    for name in ("rgb", "depth", "instance", "objects"):
        assert rows[f"/scene/camera/image/{name}"] == 2
