"""The floors that a copy has, with the splits of Table 4; what it lacks is named."""

import shutil

import pytest

from langwm_data.config_io import ConfigError
from langwm_data.scenes.igibson.source import IGibson, folder_of
from langwm_data.scenes.splits import IGIBSON_BUILDINGS, split_of_scene

TABLE_4 = {
    "train": (
        *(
            "Beechwood_0",
            "Beechwood_1",
            "Benevolence_0",
            "Benevolence_1",
            "Benevolence_2",
            "Merom_0",
            "Merom_1",
        ),
        *("Pomaria_0", "Pomaria_1", "Pomaria_2", "Wainscott_0", "Wainscott_1"),
    ),
    "test": ("Ihlen_0", "Ihlen_1", "Rs_0"),
}


def test_all_fifteen_floors_have_the_splits_of_table_4(dataset):
    for name in (*TABLE_4["train"], *TABLE_4["test"]):
        (dataset.root / folder_of(name)).mkdir(exist_ok=True)
    source = IGibson(dataset.root, seed=0)
    assert {split: source.names(split) for split in TABLE_4} == TABLE_4
    assert len(source.names()) == 15
    for split, names in TABLE_4.items():
        assert {split_of_scene(name, IGIBSON_BUILDINGS) for name in names} == {split}
    assert [folder_of(n) for n in TABLE_4["test"]] == [
        "scenes/Ihlen_0_int",
        "scenes/Ihlen_1_int",
        "scenes/Rs_int",
    ]


def test_floors_that_a_copy_lacks_are_named(dataset, caplog):
    source = IGibson(dataset.root, seed=0)
    assert source.names() == ("Beechwood_0", "Rs_0")
    assert "lacks floors of Table 4: scenes/Beechwood_1_int, scenes/Benevolence_0_int" in caplog.text
    with pytest.raises(
        ConfigError, match=r"scenes\.igibson.* has no folder 'scenes/Merom_1_int'; allowed: scenes"
    ):
        source.make("Merom_1")
    with pytest.raises(ValueError, match=r"scene 'Alder_0' is unknown; allowed: Beechwood_0\.\.1"):
        source.make("Alder_0")


def test_a_split_without_floors_is_refused(dataset):
    shutil.rmtree(dataset.root / "scenes/Rs_int")
    source = IGibson(dataset.root, seed=0)
    assert source.names("train") == ("Beechwood_0",)
    message = "has no floor of the test split; allowed: a copy with scenes/Ihlen_0_int or .*scenes/Rs_int"
    with pytest.raises(ConfigError, match=message):
        source.names("test")


def test_a_folder_that_is_no_copy_is_refused(dataset, tmp_path):
    with pytest.raises(ConfigError, match="has no folder 'scenes'; allowed: a folder with scenes, objects"):
        IGibson(tmp_path / "nowhere", seed=0)
    for scene in (dataset.root / "scenes").iterdir():
        shutil.rmtree(scene)
    with pytest.raises(ConfigError, match="has none of the fifteen floors of Table 4"):
        IGibson(dataset.root, seed=0)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("materials/materials.json", r"cannot be used: materials/materials\.json: no such file"),
        ("metadata/room_categories.txt", r"cannot be used: metadata/room_categories\.txt: no such file"),
    ],
)
def test_what_all_scenes_need_is_looked_for_at_once(dataset, path, message):
    (dataset.root / path).unlink()
    with pytest.raises(ConfigError, match=message):
        IGibson(dataset.root, seed=0)


def test_the_identity_follows_the_files(dataset, source):
    assert IGibson(dataset.root, seed=1).identity == source.identity
    dataset.text("metadata/categories.txt", "walls\n")
    assert IGibson(dataset.root, seed=1).identity != source.identity
