import json
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from langwm_data import ShardDataset
from langwm_data.shards.index import COLUMN_OF_FILE
from langwm_data.shards.manifest import FRAMES_FILE, MANIFEST_FILE, OBJECTS_FILE
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.stream import SampleStream


def edit_manifest(folder, **changes):
    path = folder / MANIFEST_FILE
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def edit_frames(folder, column, value):
    table = pq.read_table(folder / FRAMES_FILE)
    place = table.column_names.index(column)
    values = [value, *table[column].to_pylist()[1:]]
    table = table.set_column(place, table.schema.field(column), pa.array(values, table.schema.types[place]))
    pq.write_table(table, folder / FRAMES_FILE)


def test_every_sample_is_the_one_that_was_written(folder, sample_at):
    dataset = ShardDataset(folder)
    assert len(dataset) == 15
    for number, sample in enumerate(dataset):
        written = sample_at("train", number) if number < 13 else sample_at("test", number - 13)
        assert sample.key == written.key == dataset.keys[number]
        np.testing.assert_array_equal(sample.rgb, written.rgb)
        np.testing.assert_array_equal(sample.depth, written.depth)
        np.testing.assert_array_equal(sample.instance, written.instance)
        assert sample.meta == json.loads(json.dumps(written.meta))
        assert sample.caption == written.caption


def test_samples_are_found_by_number_and_key(folder):
    dataset = ShardDataset(str(folder))
    assert dataset["Alder_0-000007"].key == dataset[7].key == dataset[-8].key
    with pytest.raises(IndexError):
        dataset[15]
    with pytest.raises(KeyError):
        dataset["Alder_0-999999"]


def test_tables_agree_with_the_samples(folder):
    dataset = ShardDataset(folder)
    objects = dataset.objects.to_pylist()
    for sample, row in zip(dataset, dataset.frames.to_pylist(), strict=True):
        mine = [o for o in objects if o["key"] == sample.key]
        assert row["num_objects"] == len(mine) == len(sample.meta["objects"])
        assert row["num_captions"] == sum(len(o["captions"]) for o in mine)
        assert (row["camera_x"], row["camera_y"], row["camera_z"]) == (1.5, 2.5, 0.3)
        assert (row["caption"], row["materials"]) == (sample.caption, sample.meta["palette"])
        for table, meta in zip(mine, sample.meta["objects"], strict=True):
            assert [table[c] for c in ("x1", "y1", "x2", "y2")] == meta["bbox_xyxy"]
            assert [table["center_x"], table["center_y"]] == meta["center_px"]
            assert table["captions"] == meta["captions"]
            assert np.tan(table["bearing_rad"]) == pytest.approx((16 - meta["center_px"][0]) / 29)


def test_select_by_split_frame_and_object(folder):
    dataset = ShardDataset(folder)
    assert dataset.select(split="test").keys == ["Rowan_0-000000", "Rowan_0-000001"]
    chairs = dataset.select(split="train", objects=pc.field("category") == "chair")
    assert chairs.keys == [f"Alder_0-{n:06d}" for n in (3, 6, 9, 12)]
    assert set(chairs.objects["key"].to_pylist()) == set(chairs.keys)
    bare = dataset.select(filter=pc.field("num_captions") == 0)
    assert bare.keys == ["Alder_0-000000", "Alder_0-000005", "Alder_0-000010", "Rowan_0-000000"]
    assert chairs[1].key == chairs["Alder_0-000006"].key == "Alder_0-000006"
    with pytest.raises(KeyError):
        chairs["Alder_0-000001"]
    with pytest.raises(DatasetError, match=r"no split 'val' in .*; there are: train, test"):
        dataset.select(split="val")


def test_streams_read_samples_and_restore(folder):
    dataset = ShardDataset(folder)
    first = dataset.iter(shuffle_seed=4, part=1, num_parts=2)
    seen = [next(first).key for _ in range(3)]
    second = dataset.iter(shuffle_seed=4, part=1, num_parts=2)
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    rest = [sample.key for sample in second]
    other = [sample.key for sample in dataset.iter(shuffle_seed=4, num_parts=2)]
    assert sorted(seen + rest + other) == sorted(dataset.keys)


def test_only_the_fields_asked_for_are_decoded(own_folder, sample_at):
    dataset = ShardDataset(own_folder)
    place = dataset.frames["rgb_offset"][7].as_py()
    with (own_folder / "train/train-000001.tar").open("r+b") as tar:
        tar.seek(place)
        tar.write(b"damage")
    part = dataset.only("meta", "depth")
    assert len(part) == 15
    assert set(part[7]) == {"key", "meta", "depth"}
    assert part[7]["key"] == "Alder_0-000007"
    np.testing.assert_array_equal(part["Alder_0-000007"]["depth"], sample_at("train", 7).depth)
    stream = SampleStream(part, shuffle_seed=1)
    assert sorted(sample["key"] for sample in stream) == sorted(sample["key"] for sample in part)
    with pytest.raises(DatasetError, match=r"sample 'Alder_0-000007': rgb\.png is not a PNG of uint8"):
        dataset[7]


@pytest.mark.parametrize("fields", [(), ("rgb", "colour")])
def test_fields_that_no_sample_has_are_refused(folder, fields):
    with pytest.raises(ValueError, match="allowed: one or more of rgb, depth, instance, meta, caption"):
        ShardDataset(folder).only(*fields)


def test_threads_and_pickles_read_the_same(folder):
    dataset = ShardDataset(folder)
    copy = pickle.loads(pickle.dumps(dataset))
    with ThreadPoolExecutor(4) as pool:
        threaded = list(pool.map(lambda n: copy[n].rgb.sum(), range(15)))
    assert threaded == [sample.rgb.sum() for sample in dataset]


def test_what_is_no_dataset_is_refused(tmp_path, folder):
    with pytest.raises(DatasetError, match=r"no dataset at '.*nowhere': the folder does not exist"):
        ShardDataset(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=r"no finished dataset at '.*': it has no dataset\.json"):
        ShardDataset(tmp_path)
    with pytest.raises(ValueError, match=r"no dataset at '.*dataset\.json': it is a file; give the folder"):
        ShardDataset(folder / MANIFEST_FILE)
    with pytest.raises(DatasetError, match=r"no scene 'Elm_0' in .*; there are: Alder_0, Rowan_0"):
        ShardDataset(folder).scene("Elm_0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"schema_version": 3, "gener', "dataset.json is damaged: it is not JSON"),
        ("[3]", "dataset.json is damaged: it has no schema_version"),
        ('{"schema_version": 7}', "schema version 7; this program reads 3"),
        ('{"schema_version": 3}', "dataset.json: generator: Field required"),
    ],
)
def test_a_damaged_manifest_is_refused(own_folder, text, message):
    (own_folder / MANIFEST_FILE).write_text(text)
    with pytest.raises(DatasetError, match=message):
        ShardDataset(own_folder)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"wall": 1, "chair": 4}, r"dataset\.json: category_ids has no number for 'sofa'"),
        (
            {"wall": 1, "chair": 4, "sofa": 256},
            r"dataset\.json: category_ids\.sofa: .* less than or equal to 255",
        ),
        (
            {"wall": 0, "chair": 4, "sofa": 6},
            r"dataset\.json: category_ids\.wall: .* greater than or equal to 1",
        ),
    ],
)
def test_categories_without_a_number_that_fits_are_refused(own_folder, numbers, message):
    edit_manifest(own_folder, category_ids=numbers)
    with pytest.raises(DatasetError, match=message):
        ShardDataset(own_folder)


def test_semantic_masks_follow_the_manifest(folder):
    dataset = ShardDataset(folder)
    ids = dataset.manifest.category_ids
    sample = dataset[1]
    mask = sample.semantic(ids)
    for obj in sample.meta["objects"]:
        assert set(mask[sample.instance == obj["instance"]].tolist()) == {ids[obj["category"]]}
    assert sample.semantic({name: 7 for name in ids}).tolist() == np.full(mask.shape, 7).tolist()


def test_a_shard_outside_the_folder_is_refused(own_folder):
    shards = json.loads((own_folder / MANIFEST_FILE).read_text())["shards"]
    shards[0]["path"] = "../secret.tar"
    edit_manifest(own_folder, shards=shards)
    with pytest.raises(DatasetError, match=r"shard path '\.\./secret\.tar' is not of the form"):
        ShardDataset(own_folder)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("shard", "../secret.tar", "names shard '../secret.tar', which is not in the manifest"),
        ("rgb_offset", -512, "points outside a shard"),
        ("json_bytes", 10**12, "points outside a shard"),
        ("json_bytes", 2**63 - 1, "points outside a shard"),
        ("rgb_offset", None, "has empty fields"),
        ("key", "../../secret", "has a key of other characters than"),
    ],
)
def test_an_index_that_points_elsewhere_is_refused(own_folder, column, value, message):
    edit_frames(own_folder, column, value)
    with pytest.raises(DatasetError, match=message):
        ShardDataset(own_folder)


def test_a_missing_or_foreign_index_is_refused(own_folder):
    pq.write_table(pa.table({"a": [1]}), own_folder / OBJECTS_FILE)
    dataset = ShardDataset(own_folder)
    with pytest.raises(DatasetError, match="has other columns than this program writes"):
        _ = dataset.objects
    pq.write_table(dataset.frames.slice(1), own_folder / FRAMES_FILE)
    with pytest.raises(DatasetError, match="has 14 rows; the manifest says 15"):
        ShardDataset(own_folder)
    (own_folder / FRAMES_FILE).unlink()
    with pytest.raises(DatasetError, match="is missing or is not a parquet file"):
        ShardDataset(own_folder)


def test_a_missing_or_short_shard_is_named_when_read(own_folder):
    dataset = ShardDataset(own_folder)
    tar = own_folder / "train/train-000001.tar"
    tar.write_bytes(tar.read_bytes()[:2000])
    with pytest.raises(DatasetError, match=r"train-000001\.tar is shorter than its index says"):
        dataset[7]
    tar.unlink()
    with pytest.raises(DatasetError, match=r"train-000001\.tar is missing"):
        dataset[7]
    assert dataset[0].key == "Alder_0-000000"


def test_the_index_says_where_every_file_lies(folder):
    row = ShardDataset(folder).frames.slice(14, 1).to_pylist()[0]
    data = (folder / row["shard"]).read_bytes()
    parts = {k: data[row[f"{c}_offset"] :][: row[f"{c}_bytes"]] for k, c in COLUMN_OF_FILE.items()}
    assert parts["rgb.png"].startswith(b"\x89PNG")
    assert parts["txt"].decode() == row["caption"] != ""
