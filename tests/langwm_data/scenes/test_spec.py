"""A scene is frozen data that survives JSON."""

import dataclasses
import json

import numpy as np
import pytest

from langwm_data.scenes.spec import (
    IDENTITY,
    FloorMap,
    MaterialRef,
    MaterialSlot,
    ObjectSpec,
    PartSpec,
    RoomSpec,
    SceneSpec,
    SurfaceSpec,
)


def make_scene() -> SceneSpec:
    box = PartSpec(shape="box", size=(1.0, 1.0, 0.5), position=(0.0, 0.0, 0.25), slot=1)
    table = ObjectSpec(
        instance=7,
        category="table",
        model="table_01",
        room="kitchen",
        position=(1.0, 2.0, 0.0),
        orientation=IDENTITY,
        size=(1.0, 1.0, 0.5),
        parts=(box,),
        phrase="small table",
    )
    floor = PartSpec(shape="box", size=(4.0, 4.0, 0.1), position=(2.0, 2.0, -0.05), slot=0)
    return SceneSpec(
        name="Alder_0",
        building="Alder",
        floor=0,
        split="train",
        height_m=2.5,
        rooms=(RoomSpec(name="kitchen", kind="kitchen", rect=(0.0, 0.0, 4.0, 4.0)),),
        doorways=(),
        surfaces=(SurfaceSpec(instance=1, kind="floor", room="kitchen", part=floor),),
        objects=(table,),
        slots=(
            MaterialSlot(name="floor", categories=("tiles",)),
            MaterialSlot(name="table", categories=("wood", "plastic")),
        ),
        palette=(MaterialRef(category="tiles", id=1), MaterialRef(category="wood", id=3)),
    )


def test_scene_round_trips_through_canonical_json():
    scene = make_scene()
    again = SceneSpec.from_json(scene.to_json())
    assert again == scene
    assert again.to_json() == scene.to_json()


def test_scene_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        make_scene().name = "other"  # pyright: ignore[reportAttributeAccessIssue]


def test_materials_read_as_in_the_papers_table():
    ref = MaterialRef(category="wood_floor", id=6)
    assert str(ref) == "wood_floor/06"
    assert MaterialRef.parse("wood_floor/06") == ref


def test_instances_name_surfaces_and_objects():
    assert make_scene().instances() == {
        1: ("floor", "kitchen_floor", "floor"),
        7: ("table", "table_01", "small table"),
    }


def test_palette_of_another_size_is_refused():
    with pytest.raises(ValueError, match="palette has 1 materials; scene Alder_0 has 2 slots"):
        make_scene().with_palette([MaterialRef(category="tiles", id=1)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 9}, "scene schema version 9; this program reads 2"),
        ({"extra": 1}, "not a scene: extra"),
        ({"height_m": "tall"}, "not a scene: height_m"),
    ],
)
def test_foreign_documents_are_refused(change, message):
    text = json.dumps(json.loads(make_scene().to_json()) | change)
    with pytest.raises(ValueError, match=message):
        SceneSpec.from_json(text)
    with pytest.raises(ValueError, match="not a scene"):
        SceneSpec.from_json("{")


def test_a_floor_map_answers_as_the_mask_that_it_was_made_of():
    mask = np.random.default_rng(0).random((30, 20)) < 0.6
    floor = FloorMap.of_mask(mask, origin=(-1.5, 2.0), resolution_m=0.1)
    again = SceneSpec.from_json(dataclasses.replace(make_scene(), floor_map=floor).to_json()).floor_map
    assert again == floor
    centers = (np.stack(np.indices(mask.shape), axis=-1) + 0.5) * 0.1 + (-1.5, 2.0)
    np.testing.assert_array_equal(again.free_at(centers), mask)
    outside = np.array([(-1.51, 2.5), (1.51, 2.5), (0.0, 1.99), (0.0, 4.01)])
    assert not again.free_at(outside).any()
