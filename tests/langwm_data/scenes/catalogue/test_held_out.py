"""Datasets whose test frames differ from training in some ways only: what they show, and what is proved."""

import json

import pytest

from langwm_data import ShardDataset, render_dataset
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig, ScenesConfig
from langwm_data.config_io import ConfigError, build_config, config_to_dict
from langwm_data.fingerprint import fingerprint_of
from langwm_data.scenes.homes import Homes, scene_names
from langwm_data.scenes.splits import EVERYTHING, check_models, check_palette, describe_held_out, texture_ids
from langwm_data.shards.manifest import MANIFEST_FILE, read_manifest
from langwm_data.shards.ood import verify_ood
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.verify import verify_dataset

PURE = ((), ("buildings",), ("textures",), ("models",))


def config_of(furniture, holds_out, **splits):
    return build_config(
        DatasetConfig,
        {
            "frames": 3,
            "camera": {"height": 48, "width": 60},
            "render": {"texture_px": 16},
            "scenes": {"furniture": str(furniture)},
            "splits": {"test_fraction": 1, "holds_out": holds_out} | splits,
        },
    )


def textures_of(split):
    return {(category, i) for category in ("wood", "paint", "tiles") for i in texture_ids(category, split)}


@pytest.mark.parametrize("holds_out", PURE)
def test_test_frames_differ_from_training_in_what_is_held_out_alone(furnish, tmp_path, holds_out):
    furniture = furnish()
    out = render_dataset(config_of(furniture, holds_out), tmp_path / "data")
    report = verify_ood(out)
    assert report.is_sound, report.as_text()
    proved = report.as_text().splitlines()[-1]
    assert proved.startswith(f"proved: test frames show {describe_held_out(holds_out)}, and share all else")
    assert verify_dataset(out).is_sound
    dataset = ShardDataset(out)
    floors = set(dataset.frames["scene"].to_pylist())
    assert floors <= set(scene_names("test" if "buildings" in holds_out else "train"))
    shown = {tuple(t.split("/")) for held in dataset.frames["materials"].to_pylist() for t in held}
    side = "test" if "textures" in holds_out else "train"
    assert {(c, int(i)) for c, i in shown if c in ("wood", "paint", "tiles")} <= textures_of(side)
    records = [record for name in floors for record in dataset.scene(name).models]
    assert {record.split for record in records} == {"test" if "models" in holds_out else "train"}
    assert f"test frames show {describe_held_out(holds_out)}" in (out / "README.md").read_text("utf-8")


def test_what_is_not_held_out_is_as_in_training(furnish):
    furniture = furnish()
    training = Homes(0, furniture).make("Alder_0")
    same = Homes(0, furniture, ()).make("Alder_0")
    assert (same.split, same.objects, same.rooms, same.palette) == (
        "test",
        training.objects,
        training.rooms,
        training.palette,
    )
    papered = Homes(0, furniture, ("textures",)).make("Alder_0")
    assert papered.objects == training.objects
    assert papered.palette != training.palette
    check_palette(papered, ("textures",))
    furnished = Homes(0, furniture, ("models",)).make("Alder_0")
    assert furnished.rooms == training.rooms
    assert furnished.objects != training.objects
    check_models(furnished, ("models",))
    with pytest.raises(ValueError, match=r"model .* is for test"):
        check_models(furnished, ("textures",))
    with pytest.raises(ValueError, match="marked test; building Alder is for train"):
        check_palette(same)


def test_a_dataset_that_holds_out_less_than_it_says_is_not_proved(furnish, tmp_path):
    out = render_dataset(config_of(furnish(), ()), tmp_path / "data")
    manifest = json.loads((out / MANIFEST_FILE).read_text())
    found = []
    for holds_out in (("textures",), ("models",), ("buildings",), EVERYTHING):
        manifest["config"]["splits"]["holds_out"] = list(holds_out)
        (out / MANIFEST_FILE).write_text(json.dumps(manifest))
        report = verify_ood(out)
        assert not report.is_sound
        found.append(report.as_text())
    assert "is for training only, the frame is for test" in found[0]
    assert "no scene has a furniture model that is for test" in found[1]
    assert "is for train, the frame is for test" in found[2]
    manifest["config"]["splits"]["holds_out"] = ["wallpaper"]
    (out / MANIFEST_FILE).write_text(json.dumps(manifest))
    with pytest.raises(DatasetError, match=r"dataset\.json: config: field 'holds_out\.0'"):
        verify_ood(out)


def test_scenes_of_another_choice_are_not_read_in_place_of_those_asked_for(furnish, tmp_path):
    furniture = furnish()
    out = render_dataset(config_of(furniture, ("models",)), tmp_path / "data")
    with pytest.raises(
        ConfigError, match=r"holds scenes of splits.holds_out \['models'\]; allowed: a dataset"
    ):
        open_scenes(ScenesConfig(furniture=str(furniture), baked=str(out)))


def test_a_dataset_that_holds_out_everything_is_what_it_was_before_there_was_a_choice():
    values = config_to_dict(DatasetConfig())
    assert values["splits"].pop("holds_out") == list(EVERYTHING)
    facts = {"sources": {}, "physics": "p", "renderer": "r", "generator": "g", "schema_version": 3}
    old, new = (fingerprint_of(v, **facts) for v in (values, config_to_dict(DatasetConfig())))
    assert old == new
    fewer = config_to_dict(build_config(DatasetConfig, {"splits": {"holds_out": ["buildings"]}}))
    assert fingerprint_of(fewer, **facts) != old


def test_a_manifest_without_the_choice_holds_out_everything(furnish, tmp_path):
    out = render_dataset(config_of(furnish(), ()), tmp_path / "data")
    manifest = json.loads((out / MANIFEST_FILE).read_text())
    assert read_manifest(out).holds_out == ()
    del manifest["config"]["splits"]["holds_out"]
    (out / MANIFEST_FILE).write_text(json.dumps(manifest))
    assert read_manifest(out).holds_out == EVERYTHING


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"splits": {"holds_out": ["textures"]}},
            r"splits\.holds_out \['textures'\] without buildings needs splits\.test_fraction 1, not 0\.1",
        ),
        (
            {"splits": {"holds_out": ["textures", "buildings"]}},
            r"splits\.holds_out \['textures', 'buildings'\] is not some of .*, in this order",
        ),
        ({"splits": {"holds_out": ["walls"]}}, r"field 'splits\.holds_out\.0': value 'walls' is not allowed"),
        (
            {"splits": {"holds_out": ["models"], "test_fraction": 1}},
            r"splits\.holds_out \['models'\] needs scenes\.furniture",
        ),
        (
            {"splits": {"holds_out": ["buildings"]}, "scenes": {"igibson": "somewhere"}},
            r"splits\.holds_out \['buildings'\] is for homes, not for scenes\.igibson",
        ),
    ],
)
def test_what_cannot_be_held_out_is_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        build_config(DatasetConfig, values)


def test_held_out_things_have_names():
    assert describe_held_out(()) == "nothing unseen but views"
    assert describe_held_out(EVERYTHING) == "unseen buildings, textures and furniture"
