"""Frames come back as they were rendered, in an order that depends on seed and step alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.config_io import ConfigError
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.sample import decode_fields
from pretrain.dataset import FrameDataset, batch_numbers, open_split

SIZE = (32, 48)


@pytest.mark.parametrize("ram_mib", [1, 64])
def test_frames_equal_the_shards_from_memory_and_from_disk(data_folder, ram_mib, monkeypatch):
    shards = ShardDataset(data_folder).select(split="train")
    frames = FrameDataset(shards, SIZE, ram_mib)
    for _ in range(2):
        batch = frames.batch([3, 0, 11])
        for i, number in enumerate([3, 0, 11]):
            assert np.array_equal(batch.rgb[i], shards[number].rgb)
            assert np.array_equal(batch.depth[i], shards[number].depth)
    assert not batch.has_reward.any()


def test_only_colour_and_depth_are_decoded(data_folder, monkeypatch):
    frames = open_split(data_folder, "train", SIZE, 0)
    decoded = []
    monkeypatch.setattr(
        "langwm_data.shards.dataset.decode_fields",
        lambda files, key: decoded.extend(files) or decode_fields(files, key),
    )
    frames.batch([1, 2])
    assert decoded == ["rgb.png", "depth.png"] * 2


def test_memory_stays_within_its_limit(data_folder):
    shards = ShardDataset(data_folder).select(split="train")
    small = FrameDataset(shards, SIZE, 0)
    assert small.batch([5]).rgb.shape == (1, *SIZE, 3)
    assert small._rgb.nbytes + small._depth_mm.nbytes == 0
    large = FrameDataset(shards, SIZE, 1)
    assert large._rgb.nbytes + large._depth_mm.nbytes <= 2**20


def test_held_frames_are_not_read_again(data_folder, monkeypatch):
    frames = open_split(data_folder, "train", SIZE, 64)
    frames.batch([1, 2])
    monkeypatch.setattr(frames, "_images", None)
    assert len(frames.batch([2, 1, 1])) == 3


def test_objects_are_those_with_captions(data_folder):
    frames = open_split(data_folder, "train", SIZE, 64)
    shards = ShardDataset(data_folder).select(split="train")
    for number, held in enumerate(frames.batch(range(len(frames))).objects):
        labels = [o for o in shards[number].meta["objects"] if o["captions"]]
        assert [(o.category, list(o.bbox_xyxy), o.center_x, o.distance_m) for o in held] == [
            (o["category"], list(o["bbox_xyxy"]), o["center_px"][0], o["distance_m"]) for o in labels
        ]


@given(
    num_frames=st.integers(1, 30),
    batch_size=st.integers(1, 40),
    seed=st.integers(0, 9),
    steps=st.integers(1, 9),
)
@settings(max_examples=60, deadline=None)
def test_every_frame_comes_once_in_every_epoch(num_frames, batch_size, seed, steps):
    stream = [n for step in range(steps) for n in batch_numbers(seed, step, batch_size, num_frames)]
    assert len(stream) == steps * batch_size
    for start in range(0, len(stream) - num_frames + 1, num_frames):
        assert sorted(stream[start : start + num_frames]) == list(range(num_frames))


def test_epochs_and_seeds_differ():
    epochs = [tuple(batch_numbers(0, step, 20, 20)) for step in range(3)]
    assert len({*epochs, tuple(batch_numbers(1, 0, 20, 20))}) == 4


def test_split_that_was_not_rendered(make_dataset, tmp_path):
    folder = make_dataset(tmp_path / "data", num_train=2, num_test=0)
    assert open_split(folder, "test", SIZE, 64) is None


def test_frames_of_another_size_are_refused(data_folder):
    with pytest.raises(ConfigError, match=r"has frames of 32x48; mae.height and mae.width ask for 128x160"):
        open_split(data_folder, "train", (128, 160), 64)


def test_folder_without_a_dataset_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no finished dataset at"):
        open_split(tmp_path, "train", SIZE, 64)
