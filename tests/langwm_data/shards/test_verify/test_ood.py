"""The proof that nothing held out for testing is shown in training, and how it fails."""

import json

import pytest

from langwm_data import ShardDataset
from langwm_data.scenes.splits import ALL_BUILDINGS, HELD_OUT_TEXTURE_IDS
from langwm_data.shards.leaks import sample_leaks
from langwm_data.shards.ood import verify_ood


def swap_palette(texture):
    return lambda document: document["palette"].__setitem__(0, texture)


def test_a_rendered_dataset_is_proved_and_counted(sound):
    report = verify_ood(sound)
    assert report.is_sound, report.as_text()
    lines = report.as_text().splitlines()
    assert lines[-1] == "proved: no held-out building, model or texture appears in training"
    assert lines[0].startswith("train: 8 frames of 1 buildings (")
    assert lines[2].startswith("in both: 0 buildings, 0 textures, ")
    dataset = ShardDataset(sound)
    for split, shown in report.shown.items():
        frames = dataset.select(split=split).frames
        assert set(shown.buildings) == set(frames["building"].to_pylist())
        assert set(shown.textures) == {m for materials in frames["materials"].to_pylist() for m in materials}


def test_two_workers_prove_the_same(sound):
    calls = []
    assert verify_ood(sound, workers=2, progress=lambda *a: calls.append(a)) == verify_ood(str(sound))
    assert calls[-1] == (10, 10)


@pytest.mark.parametrize("category", HELD_OUT_TEXTURE_IDS)
def test_every_held_out_texture_is_a_leak_in_training(vandal, category):
    texture = f"{category}/{HELD_OUT_TEXTURE_IDS[category][0]:02d}"
    vandal.edit_json(swap_palette(texture))
    report = verify_ood(vandal.folder)
    assert f"{vandal.train} {vandal.key}: texture {texture} is for test only, the frame is for train" in map(
        str, report.findings
    )
    assert report.as_text().splitlines()[-1].startswith("NOT PROVED: ")


@pytest.mark.parametrize("name", [name for name, b in ALL_BUILDINGS.items() if b.split == "test"])
def test_a_held_out_building_is_a_leak_whatever_the_names_say(vandal, name):
    vandal.edit_json(lambda d: d.update(building=name))
    assert f"building {name} is for test, the frame is for train" in verify_ood(vandal.folder).as_text()
    vandal.edit_json(lambda d: d.update(building="Alder", scene=f"{name}_0"))
    assert f"building {name} is for test, the frame is for train" in verify_ood(vandal.folder).as_text()


def test_a_held_out_model_is_a_leak(sound):
    seen = verify_ood(sound).shown
    trained = sorted(seen["train"].models)[0]
    unseen = "no_such_model"
    assert verify_ood(sound, held_out_models=frozenset({unseen})).is_sound
    report = verify_ood(sound, held_out_models=frozenset({trained, unseen}))
    assert not report.is_sound
    assert {f.what for f in report.findings} == {f"model {trained} is held out for test"}
    assert all(f.where.startswith("train/") and f.key for f in report.findings)


def test_a_test_shard_among_the_training_shards_is_a_leak(vandal):
    (vandal.folder / vandal.train).write_bytes((vandal.folder / vandal.test).read_bytes())
    text = verify_ood(vandal.folder).as_text()
    assert "is for test, the frame is for train" in text
    assert "split is 'test' in a shard of train" in text
    assert "has 2 samples; the manifest says 4" in text


def test_in_buildings_of_igibson_ids_are_its_own_and_unlisted_classes_are_for_all():
    document = {"building": "Merom", "scene": "Merom_1", "objects": [], "palette": ["wood/99", "paper/07"]}
    assert sample_leaks(document, "train") == []
    document["palette"] = ["wood/05", "paper/7", "no name"]
    assert sample_leaks(document, "train") == [
        "texture wood/05 is for test only, the frame is for train",
        "texture 'paper/7' is in no table of splits",
        "texture 'no name' is not of the form wood/05",
    ]
    document |= {"building": "Rs", "scene": "Rs_0", "palette": ["wood/05", "paper/07", "wood/06"]}
    assert sample_leaks(document, "test") == ["texture wood/06 is for training only, the frame is for test"]
    # In a home there is no paper, and no wood of that number.
    document |= {"building": "Alder", "scene": "Alder_0", "palette": ["wood/99", "paper/07"]}
    assert len(sample_leaks(document, "train")) == 2


def test_a_texture_in_both_splits_is_a_leak_by_itself(vandal):
    test_key = "test frame"
    textures = verify_ood(vandal.folder).shown["test"].textures
    vandal.edit_json(swap_palette(min(textures)))
    found = [f for f in verify_ood(vandal.folder).findings if test_key in f.what]
    assert [f.key for f in found] == [vandal.key]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda v: v.edit("json", lambda d: b"{"), "json: Invalid JSON"),
        (lambda v: (v.folder / v.train).unlink(), "train/train-000000.tar: is missing"),
        (lambda v: (v.folder / v.train).write_bytes(b""), "the tar is cut off at byte 0"),
        (
            lambda v: (v.folder / "train/more.tar").write_bytes(b""),
            "train/more.tar: is no part of this dataset",
        ),
    ],
)
def test_what_cannot_be_read_is_not_proved(vandal, damage, message):
    damage(vandal)
    report = verify_ood(vandal.folder)
    assert message in report.as_text()
    assert not report.is_sound


def test_the_index_and_the_manifest_are_not_believed(vandal):
    splits = json.loads((vandal.folder / "dataset.json").read_text())["splits"]
    vandal.edit_json(lambda d: d.update(building="Rowan"))
    vandal.edit_manifest(splits={"train": splits["train"], "test": splits["test"]})
    assert not verify_ood(vandal.folder).is_sound
