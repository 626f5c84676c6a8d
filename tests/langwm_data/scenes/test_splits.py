"""Tables 4 and 5, and the check against leaks."""

import dataclasses

import numpy as np
import pytest

from langwm_data.scenes.spec import MaterialRef, MaterialSlot, SceneSpec
from langwm_data.scenes.splits import (
    BUILDINGS,
    CATALOGUE_SIZES,
    HELD_OUT_TEXTURE_IDS,
    IGIBSON_BUILDINGS,
    MATERIAL_CATEGORIES,
    check_palette,
    is_for,
    sample_palette,
    split_of_scene,
    texture_ids,
)


def make_scene(palette, *, split="train", building="Alder"):
    slots = tuple(
        MaterialSlot(name=name, categories=categories)
        for name, categories in [("table top", ("wood", "marble")), ("wall", ("paint",))]
    )
    return SceneSpec(
        name=f"{building}_0",
        building=building,
        floor=0,
        split=split,
        height_m=2.6,
        rooms=(),
        doorways=(),
        surfaces=(),
        objects=(),
        slots=slots,
        palette=tuple(MaterialRef.parse(p) for p in palette),
    )


def test_buildings_have_the_shape_of_table_4():
    floors = {
        split: [b.floors for b in BUILDINGS.values() if b.split == split] for split in ("train", "test")
    }
    assert floors == {"train": [2, 3, 2, 3, 2], "test": [2, 1]}


def test_buildings_of_igibson_are_those_of_table_4():
    names = [f"{b}_{i}" for b, building in IGIBSON_BUILDINGS.items() for i in range(building.floors)]
    assert len(names) == 15
    assert {n for n in names if split_of_scene(n, IGIBSON_BUILDINGS) == "test"} == {
        "Ihlen_0",
        "Ihlen_1",
        "Rs_0",
    }
    assert not IGIBSON_BUILDINGS.keys() & BUILDINGS.keys()


def test_pictures_are_for_one_split_unless_nothing_of_their_category_is_held_out():
    pictures = tuple(
        MaterialRef(category=c, id=i, picture="0" * 64) for c, i in (("wood", 5), ("wood", 99), ("paper", 1))
    )
    assert [is_for(m, "train") for m in pictures] == [False, True, True]
    assert [is_for(m, "test") for m in pictures] == [True, False, True]
    slots = (MaterialSlot(name="a", categories=("wood", "paper")),) * 30
    drawn = set(sample_palette(np.random.default_rng(0), slots, "train", pictures))
    assert drawn == {pictures[1], pictures[2]}


def test_table_5_holds_out_49_ids_in_22_categories():
    assert len(MATERIAL_CATEGORIES) == 22
    assert sum(map(len, HELD_OUT_TEXTURE_IDS.values())) == 49


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_splits_share_no_texture_and_leave_none_out(category):
    train, test = texture_ids(category, "train"), texture_ids(category, "test")
    assert test == HELD_OUT_TEXTURE_IDS[category]
    assert sorted((*train, *test)) == list(range(1, CATALOGUE_SIZES[category] + 1))
    assert len(train) >= 5


def test_split_of_scene_follows_its_building():
    assert split_of_scene("Birch_2") == "train"
    assert split_of_scene("Rowan_0") == "test"


@pytest.mark.parametrize("name", ["Rowan_1", "Rowan", "Oak_0", "Birch_-1", "Birch_00", ""])
def test_unknown_scene_is_refused(name):
    with pytest.raises(ValueError, match=r"is unknown; allowed: Alder_0\.\.1, .*Rowan_0$"):
        split_of_scene(name)


def test_unknown_material_category_is_refused():
    with pytest.raises(ValueError, match="material category 'gold' is unknown; allowed: asphalt"):
        texture_ids("gold", "train")


@pytest.mark.parametrize("split", ["train", "test"])
def test_sampled_palettes_never_leak_and_reach_every_id(split):
    slots = (MaterialSlot(name="any", categories=MATERIAL_CATEGORIES),)
    rng = np.random.default_rng(0)
    seen = {sample_palette(rng, slots, split)[0] for _ in range(8000)}
    allowed = {MaterialRef(category=c, id=i) for c in MATERIAL_CATEGORIES for i in texture_ids(c, split)}
    assert seen == allowed


def test_sampling_depends_on_the_generator_only():
    slots = (MaterialSlot(name="a", categories=("wood", "metal")),) * 20
    draws = [sample_palette(np.random.default_rng(3), slots, "train") for _ in range(2)]
    assert draws[0] == draws[1]


def test_clean_palettes_pass():
    check_palette(make_scene(["wood/01", "paint/01"]))
    check_palette(make_scene(["marble/02", "paint/05"], split="test", building="Rowan"))


@pytest.mark.parametrize(
    ("palette", "split", "message"),
    [
        (
            ["wood/05", "paint/01"],
            "train",
            r"slot 'table top' holds texture wood/05.* not for the train split",
        ),
        (["wood/01", "paint/05"], "test", r"slot 'table top' holds texture wood/01.* not for the test split"),
        (["wood/01", "paint/13"], "train", r"slot 'wall' holds texture paint/13"),
        (["paint/01", "paint/01"], "train", r"slot 'table top' .*; allowed categories: wood, marble"),
    ],
)
def test_leaks_are_named(palette, split, message):
    building = "Alder" if split == "train" else "Rowan"
    with pytest.raises(ValueError, match=message):
        check_palette(make_scene(palette, split=split, building=building))


def test_building_in_the_wrong_split_is_refused():
    scene = dataclasses.replace(make_scene(["wood/05", "paint/05"]), split="test")
    with pytest.raises(ValueError, match="marked test; building Alder is for train"):
        check_palette(scene)
