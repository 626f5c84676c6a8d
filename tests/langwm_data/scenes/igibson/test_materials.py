"""Materials come by class and number; what Table 5 holds out must be there, and groups name known classes."""

import json

import pytest

from langwm_data.scenes.assets import Assets
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.materials import MATERIALS_FILE, Materials, read_groups
from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS


@pytest.fixture
def table(dataset):
    return json.loads((dataset.root / MATERIALS_FILE).read_text())


def materials(dataset, table):
    dataset.json(MATERIALS_FILE, table)
    return Materials(DataFolder(dataset.root))


def test_trailing_digits_are_the_number_however_they_are_written(dataset, table, tmp_path):
    table["wood"] = {
        f"{style}{number}": {"diffuse": "train.png"}
        for style, number in zip(
            ("wood_", "Wood0", "wood-00", "x", "2k_wood_", ""),
            (*HELD_OUT_TEXTURE_IDS["wood"], 7),
            strict=True,
        )
    }
    pictures = materials(dataset, table).pictures(["wood"], Assets(tmp_path / "assets"))
    assert [m.id for m in pictures] == [2, 5, 7, 16, 22, 32]


def test_pictures_are_found_again_and_made_again_when_they_are_gone(dataset, table, tmp_path):
    assets = Assets(tmp_path / "assets")
    first = materials(dataset, table).pictures(["paper"], assets)
    assert first == (MaterialRef(category="paper", id=1, picture=first[0].picture),)
    assets.read(f"{first[0].picture}.png")
    assert materials(dataset, table).pictures(["paper"], assets) == first
    (tmp_path / "assets" / f"{first[0].picture}.png").unlink()
    assert materials(dataset, table).pictures(["paper"], assets) == first
    assets.read(f"{first[0].picture}.png")


def test_held_out_textures_that_are_not_there_are_named(dataset, table):
    del table["wood"]["wood32"]
    del table["terrazzo"]
    message = r"3 of the textures that Table 5 holds out for test .*terrazzo/06, terrazzo/08, wood/32"
    with pytest.raises(ValueError, match=message):
        materials(dataset, table)


def test_a_class_that_a_split_could_show_nothing_of_is_named(dataset, table):
    table["wood"] = {k: v for k, v in table["wood"].items() if int(k[4:]) < 51}
    found = materials(dataset, table)
    with pytest.raises(ValueError, match="class 'wood' has no texture for the train split"):
        found.check("wood", "table_0/0")
    with pytest.raises(ValueError, match="table_0/0: material class 'velvet' is not in materials"):
        found.check("velvet", "table_0/0")
    found.check("paper", "table_0/0")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wood": {"oak": {"diffuse": "train.png"}}}, "instance 'oak' does not end in a number"),
        ({"wood": {"a1": {"diffuse": "x"}, "b01": {"diffuse": "x"}}}, "class 'wood' has the number 1 twice"),
        ({"wood": {"a1": {"diffuse": None}}}, "wood/a1 has no diffuse picture"),
        ({"wood": {"a1": {"diffuse": "../../x.png"}}}, "names '../../x.png', which leads out"),
        ({"wood": {"a1": {"diffuse": "/etc/x.png"}}}, "names '/etc/x.png', which leads out"),
        ({"wood": {"a1": {}}}, "not of the form"),
        ({"wood": ["a1"]}, "not of the form"),
    ],
)
def test_tables_that_cannot_be_meant_are_refused(dataset, table, change, message):
    with pytest.raises(ValueError, match=message):
        materials(dataset, table | change)


def test_a_table_that_is_no_table_is_refused(dataset):
    with pytest.raises(ValueError, match=r"materials\.json: not of the form"):
        materials(dataset, [1])


def test_a_picture_that_is_not_there_is_named(dataset, table, tmp_path):
    table["paper"]["Paper_001"]["diffuse"] = "gone.png"
    with pytest.raises(ValueError, match=r"materials/gone\.png: no such file"):
        materials(dataset, table).pictures(["paper"], Assets(tmp_path))


def test_groups_name_classes_and_stand_ins_take_the_place_of_what_was_never_made(dataset):
    names = ["rock", "fence", "", "flower", "leaf", "cork", "mirror", "glass", "screen", "painting", "wood"]
    dataset.json("g.json", [{"1": names, "2": []}, {"a.obj": 1, "b.obj": "2"}])
    assert read_groups(DataFolder(dataset.root), "g.json") == {
        "a.obj": ("1", ("rocks", "wood", "moss", "chipboard", "metal", "paper")),
        "b.obj": ("2", ()),
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "not of the form"),
        ([{}], "not of the form"),
        ([{"1": "wood"}, {}], "a group's classes are wood; allowed: a list"),
        ([{"1": ["wood"]}, {"a.obj": 2}], "mesh 'a.obj' is of group 2, which has no classes"),
    ],
)
def test_groups_that_cannot_be_meant_are_refused(dataset, content, message):
    dataset.json("g.json", content)
    with pytest.raises(ValueError, match=message):
        read_groups(DataFolder(dataset.root), "g.json")
