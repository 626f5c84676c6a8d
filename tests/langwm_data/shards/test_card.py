"""The shards in other people's readers: Hugging Face datasets and webdataset."""

import json

import datasets
import numpy as np
import pytest
import webdataset as wds
import yaml

from langwm_data import ShardDataset
from langwm_data.shards.card import FEATURES, _as_list
from langwm_data.shards.sample import decode_sample, to_millimetres


@pytest.fixture(scope="module", autouse=True)
def _quiet_and_offline(tmp_path_factory):
    datasets.disable_progress_bars()
    old = datasets.config.HF_DATASETS_CACHE
    datasets.config.HF_DATASETS_CACHE = tmp_path_factory.mktemp("cache")
    yield
    datasets.config.HF_DATASETS_CACHE = old


def check_rows(rows, samples):
    for row, sample in zip(rows, samples, strict=True):
        assert row["__key__"].endswith(sample.key)
        np.testing.assert_array_equal(np.asarray(row["rgb.png"]), sample.rgb)
        np.testing.assert_array_equal(np.asarray(row["depth.png"]), to_millimetres(sample.depth))
        np.testing.assert_array_equal(np.asarray(row["instance.png"]), sample.instance)
        assert row["json"] == sample.meta
        assert row["txt"] == sample.caption


def test_hugging_face_loads_the_folder_unaided(folder):
    loaded = datasets.load_dataset(str(folder))
    assert set(loaded) == {"train", "test"}
    ours = ShardDataset(folder)
    check_rows(loaded["train"], ours.select(split="train"))
    check_rows(loaded["test"], ours.select(split="test"))


def test_hugging_face_streams_shards_by_name(folder):
    files = {"train": str(folder / "train/*.tar")}
    rows = datasets.load_dataset("webdataset", data_files=files, split="train", streaming=True)
    check_rows(rows, ShardDataset(folder).select(split="train"))


def test_declared_features_are_those_of_the_data(folder):
    head = yaml.safe_load((folder / "README.md").read_text().split("---\n")[1])
    declared = datasets.Features._from_yaml_list(head["dataset_info"]["features"])
    guessed = datasets.load_dataset(
        "webdataset", data_files=str(folder / "train/*.tar"), split="train"
    ).features
    assert declared == guessed
    assert head["dataset_info"]["features"] == json.loads(json.dumps(_as_list(FEATURES)))


def test_webdataset_with_our_decoder_keeps_millimetres(folder):
    url = str(folder / "train/train-{000000..000002}.tar")
    samples = list(wds.WebDataset(url, shardshuffle=False).map(decode_sample))
    for sample, ours in zip(samples, ShardDataset(folder).select(split="train"), strict=True):
        assert sample.key == ours.key
        np.testing.assert_array_equal(to_millimetres(sample.depth), to_millimetres(ours.depth))
        np.testing.assert_array_equal(sample.rgb, ours.rgb)
        assert sample.meta == ours.meta


def test_the_trap_that_the_card_warns_of_is_real(folder):
    url = str(folder / "test/test-000000.tar")
    sample = next(iter(wds.WebDataset(url, shardshuffle=False).decode("rgb8")))
    truth = to_millimetres(ShardDataset(folder)[13].depth)
    assert sample["depth.png"].dtype == np.uint8
    assert truth.max() > 255
    assert "clip them at 255" in (folder / "README.md").read_text()
