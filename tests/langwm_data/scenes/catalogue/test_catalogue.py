import pytest

from langwm_data.scenes.catalogue import catalogue as module
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.catalogue.kinds import KINDS_BY_MODEL, KINDS_BY_NAME, Kind, kind_of
from langwm_data.scenes.taxonomy import CATEGORIES


def test_models_are_listed_with_size_author_and_licence(write_catalogue):
    folder = write_catalogue(
        {"id": "Tiny#b", "name": "Burlap sofa", "category": "Living room", "elevation": 12.5},
        {"id": "Tiny#a", "name": "Spaceship", "license": "CC-BY 3.0", "doorOrWindow": "true"},
    )
    first, second = Catalogue.open(folder).models
    assert (first.id, second.id) == ("Tiny#a", "Tiny#b")
    assert second.size == pytest.approx((1.0, 1.5, 0.5))
    assert second.elevation_m == pytest.approx(0.125)
    assert second.kind == Kind(category="sofa", phrase="burlap sofa")
    assert (second.author, second.licence, second.catalogue) == ("Ann", "CC0", "Tiny")
    assert first.kind is None
    assert first.is_opening
    assert first.licence == "CC-BY 3.0"


def test_other_languages_do_not_change_names(write_catalogue):
    assert Catalogue.open(write_catalogue({})).models[0].name == "Bed"


def test_the_report_names_what_is_of_no_known_kind(write_catalogue):
    folder = write_catalogue({}, {"name": "Spaceship"}, {"name": "Spaceship"}, {"model": "/a/b.dae"},
                             files={"a/b.dae": b""})  # fmt: skip
    assert Catalogue.open(folder).report().splitlines() == [
        "1 of 4 models are of a known kind",
        "  bed: 1",
        "of no known kind:",
        "  Bedroom / Spaceship: 2",
        "left out:",
        "  Tiny#4: it is a '.dae' file; only OBJ is read",
    ]


def test_an_id_that_stands_twice_counts_once(write_catalogue):
    write_catalogue({}, name="a.sh3f")
    found = Catalogue.open(write_catalogue({}, name="b.sh3f"))
    assert [model.archive.name for model in found.models] == ["a.sh3f"]
    assert found.left_out == {"Tiny#1 of b.sh3f": "its id stands twice"}


@pytest.mark.parametrize(
    ("record", "sentence"),
    [
        ({"width": "wide"}, "'width' of model 1 is 'wide'; allowed: more than 0 to 10000 cm"),
        ({"depth": "0"}, "'depth' of model 1 is '0'; allowed: more than 0 to 10000 cm"),
        ({"height": "1e9"}, "'height' of model 1 is '1e9'; allowed: more than 0 to 10000 cm"),
        ({"elevation": "-5"}, "'elevation' of model 1 is '-5'; allowed: 0 to 10000 cm"),
        ({"elevation": "nan"}, "'elevation' of model 1 is 'nan'; allowed: 0 to 10000 cm"),
        ({"model": None}, "model 1 has no 'model'"),
        ({"model": "http://x/y.obj"}, "'model' of model 1 is 'http://x/y.obj'; allowed: a file of the cat"),
        ({"model": "/step/other.obj"}, "no file 'step/other.obj' in it"),
        ({"modelRotation": "1 0 0"}, "'modelRotation' of model 1 is '1 0 0'; allowed: nine numbers of a rot"),
        ({"modelRotation": "1 0 0 0 1 0 0 0 -1"}, "'modelRotation' of model 1 is '1 0 0 0 1 0 0 0 -1'"),
        ({"modelRotation": "2 0 0 0 1 0 0 0 1"}, "'modelRotation' of model 1 is '2 0 0 0 1 0 0 0 1'"),
    ],
)
def test_records_that_cannot_be_meant_are_refused(write_catalogue, record, sentence):
    with pytest.raises(ValueError, match=f"^tiny.sh3f: {sentence}"):
        Catalogue.open(write_catalogue(record))


def test_folders_and_files_that_are_no_catalogue_are_refused(tmp_path, write_catalogue, monkeypatch):
    with pytest.raises(ValueError, match=r"no Sweet Home 3D catalogue \(.sh3f\) in it"):
        Catalogue.open(tmp_path)
    folder = write_catalogue({}, {})
    monkeypatch.setattr(module, "MAX_MODELS", 1)
    with pytest.raises(ValueError, match=r"tiny.sh3f: 2 models; at most 1 are read"):
        Catalogue.open(folder)
    monkeypatch.setattr(module, "PROPERTIES", "Other.properties")
    with pytest.raises(ValueError, match=r"tiny.sh3f: no Other.properties in it"):
        Catalogue.open(folder)


def test_tables_name_categories_that_exist():
    kinds = [*KINDS_BY_NAME.values(), *KINDS_BY_MODEL.values()]
    assert {kind.category for kind in kinds} <= set(CATEGORIES)
    assert all(kind.phrase and kind.phrase == kind.phrase.strip() for kind in kinds)


def test_the_group_decides_where_a_name_means_two_things():
    assert kind_of("x", "Bathroom", "Bottle") == Kind(category="bottle", phrase="bottle")
    assert kind_of("x", "Office", "Chair") == Kind(category="office_chair", phrase="office chair")
    assert kind_of("x", "Living room", "Chair") == Kind(category="chair", phrase="chair")
    assert kind_of("x", "Exterior", "Bench") is None
    assert kind_of("x", "Exterior", "Rattan sofa") == Kind(category="sofa", phrase="rattan sofa")
    assert kind_of("Kator Legaz#MIDI-keyboard", "Living room", "Keyboard") is None
    assert kind_of("x", "Lights", "Lamp") is None
    assert kind_of("Scopia#living_lamp", "Lights", "Lamp") == Kind(category="floor_lamp", phrase="floor lamp")
