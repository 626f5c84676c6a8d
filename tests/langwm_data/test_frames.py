"""Drives as they stand in a dataset: small pictures of real homes."""

import json
import math
import shutil
from itertools import pairwise

import numpy as np
import pytest

from langwm_data import ShardDataset, render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config, config_to_dict, merge
from langwm_data.frames import RenderWorker
from langwm_data.plan import plan_frame
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.shards.sample import encode_sample
from langwm_data.shards.writer import sha256_of
from langwm_data.trajectories import Pose, drive

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 14,
        "seed": 3,
        "camera": {"height": 24, "width": 30},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "cameras": {"mode": "trajectory", "trajectory_length": 5, "frames_per_palette": 8},
        "shards": {"samples_per_shard": 4},
    },
)
"""Two drives on one floor, one that is cut short on another; shards end in the middle of drives."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return render_dataset(CONFIG, tmp_path_factory.mktemp("drives") / "dataset")


@pytest.fixture(scope="module")
def metas(folder):
    return [sample.meta for sample in ShardDataset(folder)]


def test_two_workers_make_the_same_drives(folder, tmp_path):
    other = render_dataset(CONFIG, tmp_path / "two", workers=2)
    tars = sorted(p.relative_to(folder) for p in folder.rglob("*.tar"))
    assert [sha256_of(other / tar) for tar in tars] == [sha256_of(folder / tar) for tar in tars]


def test_drives_are_whole_and_on_one_floor_each(metas):
    places = [(meta["trajectory"], meta["step"]) for meta in metas]
    assert places == [divmod(number, 5) for number in range(14)]
    scenes = [meta["scene"] for meta in metas]
    assert len(set(scenes[:10])) == len(set(scenes[10:])) == 1
    assert scenes[9] != scenes[10]


def test_the_recorded_actions_lead_to_the_recorded_poses(metas):
    for before, after in pairwise(metas):
        if after["step"] == 0:
            assert after["action"] == [0.0, 0.0]
            continue
        x, y, yaw = before["pose"]
        pose = drive(Pose(xy=(x, y), yaw_rad=yaw), tuple(after["action"]))
        assert [*pose.xy, pose.yaw_rad] == after["pose"]


def test_the_camera_is_where_the_pose_says_and_clear_of_everything(folder, metas):
    dataset = ShardDataset(folder)
    for meta in metas:
        x, y, yaw = meta["pose"]
        pose = np.array(meta["camera"]["camera_to_world"])
        np.testing.assert_allclose(pose[:3, 3], (x, y, CONFIG.camera.mount_height_m))
        np.testing.assert_allclose(pose[:3, 2], (math.cos(yaw), math.sin(yaw), 0), atol=1e-12)
        space = FreeSpace.from_scene(dataset.scene(meta["scene"]), robot=CONFIG.robot)
        assert space.clearance((x, y)) >= CONFIG.cameras.min_clearance_m


def test_the_index_has_the_drives(folder, metas):
    frames = ShardDataset(folder).frames
    for name in ("trajectory", "step", "action"):
        assert frames[name].to_pylist() == [meta[name] for meta in metas]
    poses = zip(*(frames[name].to_pylist() for name in ("camera_x", "camera_y", "yaw_rad")), strict=True)
    assert [list(pose) for pose in poses] == [meta["pose"] for meta in metas]


@pytest.mark.parametrize(("every", "choices"), [("block", 2), ("frame", 6)])
def test_materials_and_lights_are_drawn_as_often_as_asked(folder, tmp_path, every, choices):
    values = {"randomize": {"palette": every, "lights": every}, "render": {"backend": "embree"}}
    config = build_config(DatasetConfig, merge(config_to_dict(CONFIG), values))
    shutil.copytree(folder / "scenes", tmp_path / "scenes")
    plans = [plan_frame(config, "train", number) for number in (0, 1, 9, 10, 11, 13)]
    with RenderWorker(config, tmp_path) as worker:
        samples = [worker.make_sample(plan) for plan in plans]
    with RenderWorker(config, tmp_path) as worker:
        again = [worker.make_sample(plan) for plan in reversed(plans)][::-1]
    for sample, other in zip(samples, again, strict=True):
        assert encode_sample(sample) == encode_sample(other)
    assert len({json.dumps(sample.meta["lights"]) for sample in samples}) == choices
    assert len({tuple(sample.meta["palette"]) for sample in samples}) == choices
