"""The whole probe on a small dataset: files, sentences, and what is refused before anything is written."""

import json
import re
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
import torch

from langwm_data import atomic
from langwm_data.config_io import ConfigError, config_to_yaml
from langwm_data.scenes.spec import ModelRecord
from langwm_data.shards.scenes import write_scene
from pretrain.config import ProbeConfig, TextConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.run import probe_mae

TEST = "test frames: unseen buildings, textures and furniture"


@pytest.fixture(scope="module")
def data(make_dataset, small_scene, tmp_path_factory):
    """As the usual dataset, with scenes; the test floor's chairs are an unseen model."""
    folder = make_dataset(tmp_path_factory.mktemp("probe") / "data")
    record = ModelRecord(
        model="chair_01", split="test", name="Chair", author="A", licence="CC0", source="catalogue"
    )
    for split in ("train", "test"):
        models = (record,) if split == "test" else ()
        write_scene(folder, replace(small_scene, name=f"{split}_0", split=split, models=models))
    return folder


def save_model(folder, config, bert_folder, text, **changes):
    torch.manual_seed(0)
    mae = LanguageGroundedMAE(replace(config, **changes), TextConfig(model=str(bert_folder)), text.null_text)
    mae.save_pretrained(folder)
    return str(folder)


@pytest.fixture(scope="module")
def run(mae_config, bert_folder, text, tmp_path_factory):
    return save_model(tmp_path_factory.mktemp("mae"), mae_config, bert_folder, text)


@pytest.fixture(scope="module")
def done(run, data, tmp_path_factory):
    out = tmp_path_factory.mktemp("probe") / "out"
    seen = []
    page = probe_mae(
        ProbeConfig(run=run, data=str(data), frames=6), out, progress=lambda *counts: seen.append(counts)
    )
    return out, page, seen


def test_everything_is_written_and_counted(done):
    out, page, seen = done
    assert {path.name for path in out.iterdir()} == {
        "config.yaml",
        "features.parquet",
        "probe.json",
        "probe.parquet",
        "report.html",
    }
    assert page == out / "report.html"
    assert seen == sorted(seen)
    assert seen[-1] == (30, 30)  # 6 and 6 with hidden objects, 12 and 6 for the features


def test_summary_says_what_the_rows_say(done):
    out, _, _ = done
    rows = pq.read_table(out / "probe.parquet").to_pylist()
    errors = [r["error_object_m"] for r in rows if r["split"] == "test" and r["caption"] == "right"]
    grounding = json.loads((out / "probe.json").read_text())["grounding"]
    found = grounding["regions"]["object"]["right"]["error_m"]
    assert found["mean"] == pytest.approx(sum(errors) / len(errors))
    assert grounding["num_frames"] == 6
    names = [group["name"] for group in grounding["subsets"]]
    assert TEST in names
    assert "training frames" in names


def test_furniture_models_on_record_have_rows_of_their_own(done):
    out, _, _ = done
    rows = pq.read_table(out / "probe.parquet").to_pylist()
    chairs = {r["key"] for r in rows if r["model"] == "chair_01" and r["split"] == "test"}
    subsets = json.loads((out / "probe.json").read_text())["grounding"]["subsets"]
    counts = {group["name"]: group["num_frames"] for group in subsets}
    assert counts.get(f"{TEST}; hidden: unseen furniture models", 0) == len(chairs) > 0


def test_page_stands_alone_and_shows_the_numbers(done):
    out, page, _ = done
    text = page.read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert "<script" not in text
    summary = json.loads((out / "probe.json").read_text())
    for caption in summary["grounding"]["regions"]["object"].values():
        assert f"<td>{caption['error_m']['mean']:.3f}</td>" in text
    for score in summary["features"]:
        assert f"<td>{score['value']:.3f}</td>" in text


def test_features_have_four_rivals_less_the_other_run(done):
    out, _, _ = done
    rows = pq.read_table(out / "features.parquet").to_pylist()
    assert {(row["encoder"], row["features"]) for row in rows} == {
        ("this model", "CLS"),
        ("this model", "mean of tokens"),
        ("random encoder", "CLS"),
        ("random encoder", "mean of tokens"),
        ("raw frame", "pixels"),
    }


def test_the_same_request_gives_the_same_bytes(done, run, data, tmp_path):
    out, _, _ = done
    probe_mae(ProbeConfig(run=run, data=str(data), frames=6), tmp_path / "again")
    for name in ("probe.parquet", "features.parquet", "probe.json", "report.html"):
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes()


def test_of_a_model_of_colours_only_features_are_probed(run, mae_config, bert_folder, text, data, tmp_path):
    colours = save_model(tmp_path / "rgb", mae_config, bert_folder, text, target="rgb")
    page = probe_mae(ProbeConfig(run=colours, data=str(data), frames=6, beside=run), tmp_path / "out")
    assert "fills in colours, not depth" in page.read_text()
    assert not (tmp_path / "out" / "probe.parquet").exists()
    assert json.loads((tmp_path / "out" / "probe.json").read_text())["grounding"] is None
    rows = pq.read_table(tmp_path / "out" / "features.parquet").to_pylist()
    assert "the other run" in {row["encoder"] for row in rows}


def test_several_sentences_and_training_frames(mae_config, bert_folder, data, tmp_path):
    from pretrain.language import FrozenText

    config = TextConfig(model=str(bert_folder), num_sentences=2)
    torch.manual_seed(0)
    LanguageGroundedMAE(mae_config, config, FrozenText(config).null_text).save_pretrained(tmp_path / "mae")
    page = probe_mae(
        ProbeConfig(run=str(tmp_path / "mae"), data=str(data), frames=4, split="train"), tmp_path / "out"
    )
    assert "4 training frames" in page.read_text()


def refuse(out, message, **fields):
    with pytest.raises(ConfigError, match=message):
        probe_mae(ProbeConfig(frames=6, **fields), out)
    assert not out.exists()


def test_a_device_that_is_not_there_is_refused(run, data, tmp_path):
    message = "device 'abacus' cannot be used on this machine; cpu always can"
    refuse(tmp_path / "out", message, run=run, data=str(data), device="abacus")


def test_datasets_of_one_split_are_refused(run, make_dataset, tmp_path):
    for split, counts in (("test", {"num_test": 0}), ("train", {"num_train": 0})):
        folder = make_dataset(tmp_path / split, **counts)
        refuse(tmp_path / "out", f"has no {split} frames; a probe needs", run=run, data=str(folder))


def test_frames_of_another_size_are_refused(mae_config, bert_folder, text, run, data, tmp_path):
    large = save_model(tmp_path / "large", mae_config, bert_folder, text, height=64)
    refuse(tmp_path / "out", "has frames of 32x48", run=large, data=str(data))
    message = r"--beside '.*' reads frames of 64x48; '.*' reads 32x48"
    refuse(tmp_path / "out", message, run=run, data=str(data), beside=large)


def test_frames_without_objects_are_refused(run, data, tmp_path, monkeypatch):
    monkeypatch.setattr("pretrain.dataset._objects_by_frame", lambda shards: [[] for _ in shards.keys])
    refuse(tmp_path / "out", "show no object that could be hidden", run=run, data=str(data))


def test_a_folder_that_is_not_of_a_probe_is_left_alone(run, data, tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(ConfigError, match=r"is not empty and holds no config\.yaml"):
        probe_mae(ProbeConfig(run=run, data=str(data), frames=6), tmp_path)
    other = tmp_path / "other"
    atomic.write_text(other / "config.yaml", config_to_yaml(ProbeConfig(run=run, data=str(data), frames=5)))
    with pytest.raises(ConfigError, match="frames \\(5 there, 6 asked for\\)"):
        probe_mae(ProbeConfig(run=run, data=str(data), frames=6), other)
    assert [path.name for path in other.iterdir()] == ["config.yaml"]


def test_another_probe_may_start_over_in_the_folder_of_a_finished_one(done, run, data):
    out, _, _ = done
    with pytest.raises(ConfigError, match=r"frames \(6 there, 5 asked for\); .* or --fresh to start over$"):
        probe_mae(ProbeConfig(run=run, data=str(data), frames=5), out)


def test_what_is_no_model_is_refused(data, tmp_path):
    with pytest.raises(ValueError, match="holds no pretrained autoencoder"):
        probe_mae(ProbeConfig(run=str(tmp_path / "nowhere"), data=str(data)), tmp_path / "out")


@pytest.fixture
def other(make_dataset, small_scene, tmp_path):
    """Makes a dataset of test frames with changes to its manifest."""

    def make(name="other", num_train=0, **changes):
        folder = make_dataset(tmp_path / name, num_train=num_train, num_test=5)
        write_scene(folder, replace(small_scene, name="test_0", split="test"))
        edit_manifest(folder, **changes)
        return str(folder)

    return make


def edit_manifest(folder, **changes):
    path = folder / "dataset.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def holding_out(*kinds):
    return {"config": {"splits": {"holds_out": list(kinds)}}}


def test_datasets_that_hold_out_less_have_a_row_each(run, data, other, tmp_path):
    others = (other("views", **holding_out()), other("walls", **holding_out("textures")))
    seen = []
    config = ProbeConfig(run=run, data=str(data), others=others, frames=4)
    page = probe_mae(config, tmp_path / "out", progress=lambda *counts: seen.append(counts))
    assert seen[-1] == (4 * 4 + 4 + 12, 4 * 4 + 4 + 12)
    titles = [
        "training frames",
        "test frames: nothing unseen but views",
        "test frames: unseen textures",
        TEST,
    ]
    rows = pq.read_table(tmp_path / "out" / "probe.parquet").to_pylist()
    assert list(dict.fromkeys(row["frames"] for row in rows)) == titles
    assert {row["split"] for row in rows if row["frames"] != "training frames"} == {"test"}
    subsets = json.loads((tmp_path / "out" / "probe.json").read_text())["grounding"]["subsets"]
    found = {group["name"]: group for group in subsets}
    assert [name for name in found if name in titles] == titles
    mine = [r for r in rows if r["frames"] == titles[2]]
    right, empty = (
        [r["error_object_m"] for r in mine if r["caption"] == name and r["error_object_m"] is not None]
        for name in ("right", "empty")
    )
    assert found[titles[2]]["num_frames"] == len(right) == 4
    assert found[titles[2]]["captions"]["right"]["error_m"]["mean"] == pytest.approx(sum(right) / 4)
    assert found[titles[2]]["saved"]["mean"] == pytest.approx(1 - sum(right) / sum(empty))
    assert f"<td>{titles[2]}</td>" in page.read_text()


def test_datasets_that_do_not_belong_together_are_refused(run, data, other, tmp_path):
    def refuse_others(message, *others):
        refuse(tmp_path / "out", message, run=run, data=str(data), others=others)

    walls = other("walls", **holding_out("textures"))
    again = other("again", **holding_out("textures"))
    refuse_others("two of --data show the same kind of test frames: unseen textures", walls, again)
    seed = {"config": {"scenes": {"seed": 7}, "splits": {"holds_out": []}}}
    refuse_others(r"is of other scenes than --data .*: scenes\.seed 7 and", other("homes", **seed))
    camera = json.loads((data / "dataset.json").read_text())["camera"]
    camera["K"][0][0] = 40.0
    wide = other("wide", camera=camera, **holding_out("buildings"))
    refuse_others("was seen by another camera than --data", wide)


def test_frames_of_another_camera_than_the_model_learned_from_are_refused(run, data, tmp_path):
    mae = LanguageGroundedMAE.from_pretrained(run)
    mae.intrinsics = ((30.0, 0.0, 24.0), (0.0, 30.0, 16.0), (0.0, 0.0, 1.0))
    mae.save_pretrained(tmp_path / "same")
    probe_mae(ProbeConfig(run=str(tmp_path / "same"), data=str(data), frames=2), tmp_path / "good")
    mae.intrinsics = ((25.0, 0.0, 24.0), (0.0, 25.0, 16.0), (0.0, 0.0, 1.0))
    mae.save_pretrained(tmp_path / "other")
    message = r"focal lengths 30\.0, 30\.0 and .* learned from one of focal lengths 25\.0, 25\.0"
    refuse(tmp_path / "out", message, run=str(tmp_path / "other"), data=str(data))
