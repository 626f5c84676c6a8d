import dataclasses
from itertools import combinations

import numpy as np
import pytest

from langwm_data.config import RobotConfig
from langwm_data.scenes.checks import overlapping_pairs
from langwm_data.scenes.geometry import part_polygon
from langwm_data.scenes.homes import make_home, scene_names
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import SceneSpec
from langwm_data.scenes.splits import MATERIAL_CATEGORIES, check_palette
from langwm_data.scenes.taxonomy import CATEGORIES

ROBOT = RobotConfig()
SEEDED = [(name, 0) for name in scene_names()] + [
    (name, seed) for seed in (1, 2) for name in ("Alder_1", "Elm_0", "Rowan_0")
]
IN_WALL = {"window", "door_frame", "door"}


@pytest.fixture(scope="module")
def homes() -> dict[tuple[str, int], SceneSpec]:
    return {(name, seed): make_home(name, seed=seed) for name, seed in SEEDED}


@pytest.fixture(scope="module")
def spaces(homes) -> dict[tuple[str, int], FreeSpace]:
    return {key: FreeSpace.from_scene(scene, robot=ROBOT) for key, scene in homes.items()}


def test_there_are_twelve_floors_to_train_on_and_three_to_test():
    assert len(scene_names("train")) == 12
    assert len(scene_names("test")) == 3
    assert set(scene_names()) == set(scene_names("train")) | set(scene_names("test"))


@pytest.mark.parametrize("key", SEEDED)
def test_nothing_stands_in_another_thing_or_in_a_wall(homes, key):
    scene = homes[key]
    table = scene.instances()
    assert [(table[a], table[b]) for a, b in overlapping_pairs(scene)] == []


@pytest.mark.parametrize("key", SEEDED)
def test_the_robot_reaches_every_room_through_every_doorway(homes, spaces, key):
    scene, space = homes[key], spaces[key]
    centers = space.center(np.argwhere(space.grid))
    for room in scene.rooms:
        x0, y0, x1, y1 = room.rect
        inside = (centers[:, 0] > x0) & (centers[:, 0] < x1) & (centers[:, 1] > y0) & (centers[:, 1] < y1)
        assert inside.sum() * space.resolution_m**2 > 0.08 * (x1 - x0) * (y1 - y0), room.name
    for doorway in scene.doorways:
        assert doorway.width >= 0.9
        assert space.is_free(doorway.center), doorway.rooms
    assert space.area_m2 > 10


@pytest.mark.parametrize("key", SEEDED)
def test_objects_are_inside_their_room(homes, key):
    scene = homes[key]
    rects = {r.name: np.array(r.rect) for r in scene.rooms}
    for obj in scene.objects:
        points = np.concatenate([part_polygon(obj.position, obj.orientation, p) for p in obj.parts])
        margin = 0.12 if obj.category in IN_WALL else 1e-3
        low, high = rects[obj.room][:2] - margin, rects[obj.room][2:] + margin
        assert (points >= low).all(), (obj.category, obj.room)
        assert (points <= high).all(), (obj.category, obj.room)
        assert obj.position[2] + obj.size[2] <= scene.height_m + 1e-6


def test_what_hangs_hangs_on_a_wall(homes):
    for scene in homes.values():
        rects = {r.name: np.array(r.rect) for r in scene.rooms}
        for obj in scene.objects:
            if obj.category not in ("picture", "mirror", "curtain", "wall_cabinet", "radiator", "towel_rail"):
                continue
            points = np.concatenate([part_polygon(obj.position, obj.orientation, p) for p in obj.parts])
            rect = rects[obj.room]
            gap = min(*(points.min(axis=0) - rect[:2]), *(rect[2:] - points.max(axis=0)))
            assert 0 <= gap < 0.02, (obj.category, gap)


def test_rooms_have_what_their_kind_needs(homes):
    needs = {
        "living_room": {"sofa", "tv"},
        "kitchen": {"kitchen_sink", "stove"},
        "bedroom": {"bed"},
        "bathroom": {"toilet", "washbasin"},
        "study": {"desk"},
        "dining_room": {"dining_table", "chair"},
    }
    missing = total = 0
    for scene in homes.values():
        for room in scene.rooms:
            found = {o.category for o in scene.objects if o.room == room.name}
            total += room.kind in needs
            missing += not needs.get(room.kind, set()) <= found
    assert total > 80
    assert missing == 0


def test_televisions_stand_before_sofas(homes):
    for scene in homes.values():
        for tv in (o for o in scene.objects if o.category == "tv"):
            sofas = [o for o in scene.objects if o.category == "sofa" and o.room == tv.room]
            towards = np.subtract(sofas[0].position, tv.position)[:2]
            front = 2 * np.array([-tv.orientation[2] * tv.orientation[3], tv.orientation[3] ** 2 - 0.5])
            assert len(sofas) == 1
            assert towards @ front > 0.99 * np.linalg.norm(towards)


def test_all_homes_together_show_most_categories_and_all_materials(homes):
    floors = [homes[name, 0] for name in scene_names()]
    assert len({o.category for s in floors for o in s.objects}) >= 0.9 * len(CATEGORIES)
    assert min(len({o.category for o in s.objects}) for s in floors) >= 20
    assert {c for s in floors for slot in s.slots for c in slot.categories} == set(MATERIAL_CATEGORIES)
    assert all(any(not o.is_fixed for o in s.objects) for s in floors)


def test_a_floor_stays_small_enough_to_draw_on_a_cpu(homes):
    for scene in homes.values():
        assert 50 <= len(scene.objects) <= 150
        assert sum(1 for _ in scene.iter_parts()) < 1500


@pytest.mark.parametrize("name", ["Cedar_0", "Rowan_0"])
def test_same_seed_same_bytes_and_json_round_trip(homes, name):
    scene = homes[name, 0]
    text = scene.to_json()
    assert make_home(name, seed=0).to_json() == text
    assert SceneSpec.from_json(text) == scene
    assert make_home(name, seed=7).to_json() != text


def test_floors_differ_from_each_other(homes):
    floors = [homes[name, 0] for name in scene_names()]
    assert not any(a.rooms == b.rooms for a, b in combinations(floors, 2))


def test_palettes_keep_to_the_split_of_the_building(homes):
    for scene in homes.values():
        check_palette(scene)


def test_instances_are_unique_and_start_at_one(homes):
    for scene in homes.values():
        ids = sorted({s.instance for s in scene.surfaces} | {o.instance for o in scene.objects})
        assert ids == list(range(1, len(ids) + 1))
        assert len({o.instance for o in scene.objects}) == len(scene.objects)


def test_an_unknown_floor_is_refused():
    with pytest.raises(ValueError, match=r"scene 'Atlantis_0' is unknown; allowed: Alder_0\.\.1"):
        make_home("Atlantis_0", seed=0)


def test_a_thing_pushed_into_a_wall_or_another_thing_is_found(homes):
    scene = homes["Alder_0", 0]
    table = scene.instances()
    sofa = next(o for o in scene.objects if o.category == "sofa")
    bed = next(o for o in scene.objects if o.category == "tv_stand")
    on_top = dataclasses.replace(bed, position=sofa.position)
    outside = dataclasses.replace(bed, position=(0.1, bed.position[1], 0.0))
    for moved, partner in ((on_top, "sofa"), (outside, "wall")):
        objects = tuple(moved if o.instance == bed.instance else o for o in scene.objects)
        pairs = overlapping_pairs(dataclasses.replace(scene, objects=objects))
        assert partner in {table[i][0] for pair in pairs if bed.instance in pair for i in pair}
