"""Loose objects come to rest; unsound scenes are refused by name."""

import dataclasses

import numpy as np
import pytest

from langwm_data.scenes.homes import make_home
from langwm_data.scenes.spec import IDENTITY, ObjectSpec, PartSpec
from langwm_data.sim import drop
from langwm_data.sim.settle import check_contacts, settle


def replaced(scene, instance, **changes):
    objects = tuple(dataclasses.replace(o, **changes) if o.instance == instance else o for o in scene.objects)
    return dataclasses.replace(scene, objects=objects)


def wooden_box(size, position):
    return PartSpec(shape="box", size=size, position=position, slot=3)


def added(scene, category, position, size, parts, *, is_fixed=True):
    obj = ObjectSpec(
        instance=40,
        category=category,
        model=f"{category}_01",
        room="study",
        position=position,
        orientation=IDENTITY,
        size=size,
        parts=tuple(parts),
        is_fixed=is_fixed,
    )
    return dataclasses.replace(scene, objects=(*scene.objects, obj))


@pytest.fixture(scope="module")
def settled(small_scene):
    return settle(small_scene)


def test_loose_objects_come_to_rest_on_the_table(small_scene, settled):
    for before, after in zip(small_scene.objects, settled.objects, strict=True):
        if before.is_fixed:
            assert after == before
        else:
            assert after.position[2] == pytest.approx(0.74, abs=0.003)
            assert after.position[:2] == pytest.approx(before.position[:2], abs=0.01)
            assert abs(after.orientation[3]) > 0.999
            assert dataclasses.replace(after, position=before.position, orientation=IDENTITY) == before


def test_settling_is_repeatable_and_leaves_a_settled_scene_almost_alone(small_scene, settled):
    assert settle(small_scene) == settled
    for a, b in zip(settled.objects, settle(settled).objects, strict=True):
        np.testing.assert_allclose(a.position, b.position, atol=0.002)


def test_scene_without_loose_objects_is_returned_unchanged(small_scene):
    fixed = dataclasses.replace(small_scene, objects=small_scene.objects[:4])
    assert settle(fixed) == fixed


def test_off_centre_mass_topples_and_is_named(small_scene):
    parts = [
        wooden_box((0.05, 0.05, 0.1), (0, 0, 0.05)),
        wooden_box((0.4, 0.05, 0.05), (0.2, 0, 0.125)),
    ]
    scene = added(small_scene, "vase", (2.0, 2.0, 0.001), (0.8, 0.05, 0.15), parts, is_fixed=False)
    with pytest.raises(ValueError, match=r"vase 40 \(vase_01\) falls over: it tilts by \d+ degrees"):
        settle(scene)


def test_object_over_nothing_falls_down_and_is_named(small_scene):
    scene = replaced(small_scene, 34, position=(2.0, 1.5, 0.8))
    with pytest.raises(ValueError, match=r"box 34 .*(does not stay in its place|falls over)"):
        settle(scene)


def test_object_that_is_still_moving_when_time_is_up_is_named(small_scene, monkeypatch):
    scene = replaced(small_scene, 34, position=(2.0, 1.5, 2.0))
    monkeypatch.setattr(drop, "MAX_SECONDS", drop.REST_STEPS / drop.PHYSICS_HZ)
    with pytest.raises(ValueError, match=r"box 34 \(.*\) does not come to rest in 0\.25 s"):
        settle(scene)


def test_overlapping_furniture_is_named_with_its_depth(settled):
    scene = replaced(settled, 31, position=(0.42, 0.4, 0.0))
    with pytest.raises(ValueError, match=r"stool 31 .* and floor_lamp 32 .* overlap by \d+ mm"):
        check_contacts(scene)


def test_furniture_in_a_wall_is_named_with_its_depth(settled):
    scene = replaced(settled, 33, position=(5.95, 1.5, 0.0))
    with pytest.raises(ValueError, match=r"wall 20 .* and kitchen_cabinet 33 .* overlap by 50 mm"):
        check_contacts(scene)


def test_floating_furniture_is_named(settled):
    scene = replaced(settled, 31, position=(2.2, 0.9, 0.3))
    with pytest.raises(ValueError, match=r"stool 31 \(stool_01\) floats: nothing is near"):
        check_contacts(scene)


def test_object_that_hangs_on_the_wall_is_accepted(settled):
    picture = [wooden_box((0.5, 0.02, 0.4), (0, 0, 0.2))]
    check_contacts(added(settled, "picture", (2.0, 0.011, 1.4), (0.5, 0.02, 0.4), picture))


@pytest.mark.parametrize(("name", "seed"), [("Hazel_1", 5), ("Maple_0", 7)])
def test_a_cup_that_trembles_in_place_is_at_rest(name, seed):
    settled = settle(make_home(name, seed=seed))
    assert any(not obj.is_fixed for obj in settled.objects)
