"""Which models of catalogues homes take, and what they know of them."""

import dataclasses
import logging

import numpy as np
import pytest

from langwm_data.scenes.catalogue import offer as module
from langwm_data.scenes.catalogue.archive import ArchiveError
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.catalogue.limits import SIZES_M, misfit
from langwm_data.scenes.catalogue.offer import NUM_MODELS, Furniture, Offer
from langwm_data.scenes.spec import OWN
from langwm_data.scenes.taxonomy import CATEGORIES

BED = {"width": 160, "depth": 205, "height": 80}


def built(furniture, category):
    models = [m for split in ("train", "test") for m in furniture.of_category(category, split)]
    return [furniture.build(m) for m in models]


def test_sizes_are_those_of_categories_that_exist():
    assert set(SIZES_M) <= set(CATEGORIES)
    assert all(low < high for ranges in SIZES_M.values() for low, high in ranges)
    assert not {"window", "door", "door_frame", "curtain"} & set(SIZES_M)


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        (BED, None),
        (BED | {"width": 400}, r"4.00 m wide; homes take a bed that is 0.85 to 2.1 m wide"),
        (BED | {"depth": 20}, r"0.20 m deep; homes take a bed that is 1.85 to 2.35 m deep"),
        (BED | {"height": 300}, r"3.00 m high; homes take a bed that is 0.4 to 1.7 m high"),
        ({"name": "Curtain"}, "a curtain of a home is procedural"),
        ({"name": "Whatsit"}, "nothing says what it is"),
    ],
)
def test_models_of_other_sizes_are_not_for_homes(write_catalogue, record, reason):
    folder = write_catalogue(record)
    (model,) = Catalogue.open(folder).models
    assert misfit(model) == reason


def test_a_model_becomes_furniture_in_its_true_size(write_catalogue, cache):
    furniture = Furniture(write_catalogue(BED | {"name": "Iron bed"}, license="CC-BY 3.0"), cache)
    (bed,) = built(furniture, "bed")
    assert (bed.category, bed.size, bed.phrase) == ("bed", (1.6, 2.05, 0.8), "iron bed")
    assert bed.mesh.slots == (OWN, OWN)
    assert (cache / f"{bed.mesh.name}.npz").is_file()
    assert {part.shape for part in bed.parts} == {"box"}
    low = np.min([np.subtract(p.position, np.divide(p.size, 2)) for p in bed.parts], axis=0)
    high = np.max([np.add(p.position, np.divide(p.size, 2)) for p in bed.parts], axis=0)
    assert [*low, *high] == pytest.approx([-0.8, -1.025, 0.0, 0.8, 1.025, 0.8], abs=1e-4)
    record = dataclasses.asdict(bed.record)
    assert record == {
        "model": "Tiny#1",
        "split": "train",
        "name": "Iron bed",
        "author": "Ann",
        "licence": "CC-BY 3.0",
        "source": "Tiny",
    }


def test_a_loose_thing_is_one_box(write_catalogue, cache):
    cup = {"name": "Cup", "category": "Kitchen", "width": 9, "depth": 9, "height": 10}
    (model,) = built(Furniture(write_catalogue(cup), cache), "cup")
    (part,) = model.parts
    assert (part.size, part.position) == ((0.09, 0.09, 0.1), (0.0, 0.0, 0.05))


def test_what_hangs_keeps_its_height_where_the_floor_is_the_usual_place(furnish, cache):
    furniture = Furniture(furnish(), cache)
    (basin,) = built(furniture, "washbasin")
    assert basin.elevation_m == pytest.approx(0.45)
    assert all(bed.elevation_m == 0 for bed in built(furniture, "bed"))


def test_a_building_chooses_a_few_models_of_its_split(write_catalogue, cache, nest):
    files = {f"m{i}/box.obj": f"v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n# {i}\n" for i in range(20)}
    models = [BED | {"model": f"/m{i}/box.obj"} for i in range(20)]
    furniture = Furniture(write_catalogue(*models, files=files), cache)
    names = {}
    for building in ("Alder", "Birch"):
        for split in ("train", "test"):
            chosen = Offer(furniture, split, 0, building)
            found = [m.name for m in chosen.models(np.random.default_rng(0), "bed")]
            assert found == [m.name for m in chosen.models(np.random.default_rng(0), "bed")]
            names[building, split] = set(found)
            assert {m.record.split for m in chosen.models(np.random.default_rng(1), "bed")} == {split}
    assert len(names["Alder", "train"]) == NUM_MODELS
    assert names["Alder", "train"] != names["Birch", "train"]
    assert not names["Alder", "train"] & names["Alder", "test"]
    assert list(Offer(furniture, "train", 0, "Alder").models(np.random.default_rng(0), "sofa")) == []


def test_models_that_are_of_no_use_are_left_out_with_a_reason(write_catalogue, cache, monkeypatch, caplog):
    desk = {"name": "Desk", "category": "Office", "width": 120, "depth": 60, "height": 75}
    models = [
        BED,
        desk | {"model": "/slope/step.obj"},
        BED | {"model": "/none/step.obj"},
        BED | {"width": 500},
    ]
    slope = "v 0 0 0\nv 1 0 0\nv 0 1 1\nv 1 1 1\nf 1 2 4 3\n"
    files = {"slope/step.obj": slope, "none/step.obj": "v 0 0 0\n"}
    furniture = Furniture(write_catalogue(*models, files=files), cache)
    monkeypatch.setattr(module, "MAX_TRIANGLES", 5)
    with caplog.at_level(logging.WARNING):
        assert not any(built(furniture, "bed") + built(furniture, "desk"))
    assert "furniture model left out: tiny.sh3f!none/step.obj" in caplog.text
    report = furniture.report()
    assert "4 models of a known kind are not used:" in report
    assert "  Tiny#1: 16 triangles are left of it; homes take at most 5" in report
    assert "  Tiny#2: it has no level top, which a desk needs" in report
    assert "  Tiny#3: tiny.sh3f!none/step.obj" in report
    assert "  Tiny#4: 5.00 m wide; homes take a bed" in report


def test_models_that_are_mostly_cut_out_are_left_out(write_catalogue, cache, monkeypatch):
    furniture = Furniture(write_catalogue(BED), cache)
    monkeypatch.setattr(module, "MAX_CUT_OUT_SHARE", -0.1)
    assert built(furniture, "bed") == [None]
    assert furniture.left_out == {"Tiny#1": "0% of its surface is cut out of its textures"}


def test_a_damaged_catalogue_is_refused(write_catalogue, cache):
    folder = write_catalogue(BED)
    path = folder / "tiny.sh3f"
    data = bytearray(path.read_bytes())
    at = data.index(b"step/step.obj") + len("step/step.obj") + 40
    data[at : at + 4] = bytes(b ^ 0xFF for b in data[at : at + 4])
    path.write_bytes(bytes(data))
    furniture = Furniture(folder, cache)
    with pytest.raises(ArchiveError, match=r"tiny.sh3f: 'step/step.obj' cannot be read"):
        built(furniture, "bed")


def test_the_identity_is_that_of_the_files(write_catalogue, cache, monkeypatch):
    folder = write_catalogue(BED)
    identity = Furniture(folder, cache).identity
    assert Furniture(folder, cache).identity == identity
    write_catalogue(BED | {"width": 150})
    assert Furniture(folder, cache).identity != identity
    write_catalogue(BED)
    assert Furniture(folder, cache).identity == identity
    monkeypatch.setattr(module, "RECIPE", 999)
    assert Furniture(folder, cache).identity != identity
