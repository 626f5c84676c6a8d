"""The robot's motion: exact in the open, stopped or bent by obstacles, the same whatever came before."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.baking import open_scenes
from langwm_data.config import RobotConfig, ScenesConfig
from langwm_data.scenes.homes import make_home
from langwm_data.scenes.spec import ObjectSpec, PartSpec
from langwm_data.sim.world import SKIN_M, World, slide

ROBOT = RobotConfig()
REACH = ROBOT.radius_m + SKIN_M
OPEN = (2.0, 1.6)


@pytest.fixture(scope="module", params=["physics", "map"])
def contacts(request):
    return request.param


@pytest.fixture(scope="module")
def world(small_scene, contacts):
    world = World(small_scene, ROBOT, contacts=contacts)
    yield world
    world.close()
    world.close()


def drive(world, actions, start=OPEN, yaw=0.0):
    world.reset(start, yaw)
    return [world.step(*action) for action in actions]


def with_solid(scene, size, bottom, xy=(2.6, 1.6), shape="box"):
    part = PartSpec(shape=shape, size=size, position=(0.0, 0.0, size[2] / 2), slot=3)
    solid = ObjectSpec(
        instance=99,
        category="rug",
        model="rug_01",
        room="study",
        position=(*xy, bottom),
        orientation=(0.0, 0.0, 0.0, 1.0),
        size=size,
        parts=(part,),
    )
    return dataclasses.replace(scene, objects=(*scene.objects, solid))


def test_half_a_metre_per_second_is_five_centimetres_in_a_tenth(world):
    (state,) = drive(world, [(0.5, 0.0)], yaw=math.pi / 2)
    assert state.xy == pytest.approx((2.0, 1.65), abs=1e-12)
    assert (state.linear, state.angular, state.is_collision) == (pytest.approx(0.5), 0.0, False)


def test_turning_left_raises_yaw_and_wraps(world):
    states = drive(world, [(0.0, 1.5)] * 40)
    assert states[0].yaw == pytest.approx(0.15)
    assert states[-1].yaw == pytest.approx(6.0 - 2 * math.pi)
    assert states[-1].xy == OPEN
    assert not any(s.is_collision for s in states)


def test_constant_speeds_drive_an_arc(world):
    state = drive(world, [(0.3, 1.0)] * 5)[-1]
    radius, angle = 0.3, 0.5
    arc = (OPEN[0] + radius * math.sin(angle), OPEN[1] + radius * (1 - math.cos(angle)))
    assert state.xy == pytest.approx(arc, abs=1e-6)


def test_driving_backwards(world):
    (state,) = drive(world, [(-0.5, 0.0)])
    assert state.xy == pytest.approx((1.95, 1.6))
    assert state.linear == pytest.approx(-0.5)


def test_a_wall_stops_the_robot_at_its_surface(world):
    states = drive(world, [(0.5, 0.0)] * 30, start=(2.0, 0.5), yaw=-math.pi / 2)
    assert states[-1].xy == pytest.approx((2.0, REACH), abs=1e-4)
    assert states[-1].linear == pytest.approx(0.0, abs=1e-6)
    assert not states[0].is_collision
    assert all(s.is_collision for s in states[10:])


def test_the_robot_slides_along_a_wall(world):
    states = drive(world, [(0.5, 0.0)] * 20, start=(1.2, 0.4), yaw=-math.pi / 4)
    assert states[-1].xy[0] > 1.7
    assert states[-1].xy[1] == pytest.approx(REACH, abs=1e-4)
    assert states[-1].is_collision
    assert states[-1].linear == pytest.approx(0.25, abs=1e-3)


def test_contact_ends_when_the_robot_backs_off(world):
    world.reset((2.0, 0.5), -math.pi / 2)
    touching = [world.step(0.5, 0.0) for _ in range(10)][-1]
    turning = world.step(0.0, 1.0)
    leaving = world.step(-0.5, 0.0)
    assert (touching.is_collision, turning.is_collision, leaving.is_collision) == (True, True, False)


def test_a_corner_holds_the_robot(world):
    states = drive(world, [(0.5, 0.0)] * 60, start=(3.5, 0.6), yaw=-0.7)
    assert states[-1].xy == pytest.approx((4.0 - REACH, REACH), abs=1e-3)


def test_the_robot_passes_the_door_and_meets_the_cabinet_beyond(world):
    states = drive(world, [(0.5, 0.0)] * 60, start=(3.0, 1.45))
    assert states[-1].xy == pytest.approx((5.65 - REACH, 1.45), abs=1e-3)


def test_table_top_lets_the_robot_under_but_not_its_legs(world):
    assert not world.collides((1.0, 2.4), 0.0)
    assert world.collides((0.55, 2.3), 0.0)


@pytest.mark.parametrize(("height", "is_free"), [(0.02, True), (0.03, True), (0.06, False)])
def test_low_rug_is_driven_over_and_low_step_is_not(small_scene, contacts, height, is_free):
    world = World(with_solid(small_scene, (0.5, 0.5, height), 0.0), ROBOT, contacts=contacts)
    state = drive(world, [(0.5, 0.0)] * 10)[-1]
    assert (state.xy[0] == pytest.approx(2.5)) == is_free
    assert state.is_collision != is_free
    world.close()


@pytest.mark.parametrize(("bottom", "is_free"), [(0.5, True), (0.45, True), (0.4, False)])
def test_shelf_above_the_robot_is_passed_under(small_scene, contacts, bottom, is_free):
    world = World(with_solid(small_scene, (0.5, 0.5, 0.1), bottom), ROBOT, contacts=contacts)
    assert world.collides((2.6, 1.6), 0.0) != is_free
    world.close()


def test_what_the_robot_just_passes_over_or_under_neither_stops_nor_turns_it(small_scene):
    # Leaning a little, so that bounds alone do not tell, and half a millimetre from the robot.
    low = with_solid(small_scene, (0.5, 0.5, 0.02), 0.0)
    tilt = (math.sin(0.01), 0.0, 0.0, math.cos(0.01))
    top_m = 0.01 * math.cos(0.02) + 0.25 * math.sin(0.02) + 0.01
    leaning = dataclasses.replace(
        low.objects[-1], orientation=tilt, position=(2.6, 1.6, ROBOT.clearance_m - 0.0005 - top_m)
    )
    world = World(dataclasses.replace(low, objects=(*low.objects[:-1], leaning)), ROBOT)
    states = drive(world, [(0.5, 0.0)] * 10)
    world.close()
    assert states[-1].xy == pytest.approx((2.5, 1.6), abs=1e-9)
    assert not any(s.is_collision for s in states)


@pytest.mark.parametrize("shape", ["box", "cylinder", "ellipsoid", "frustum"])
def test_every_shape_stops_the_robot_at_its_side(small_scene, contacts, shape):
    scene = with_solid(small_scene, (0.4, 0.4, 0.46), 0.01, shape=shape)
    world = World(scene, ROBOT, contacts=contacts)
    state = drive(world, [(0.5, 0.0)] * 12)[-1]
    assert state.xy == pytest.approx((2.6 - 0.2 - REACH, 1.6), abs=0.005)
    world.close()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_robot_never_enters_anything(small_scene, world, seed):
    # Fast and at random, against walls, legs and corners; an untouched pose is what ``reset`` accepts.
    rng = np.random.default_rng(seed)
    world.reset(OPEN, 0.0)
    for _ in range(40):
        state = world.step(rng.uniform(-2, 2), rng.uniform(-3, 3))
        x, y = state.xy
        assert REACH - 1e-4 <= x <= 6.1 - REACH + 1e-4
        assert REACH - 1e-4 <= y <= 3.0 - REACH + 1e-4
        assert all(gap.distance > 0 for _, gap in world._gaps(state.xy, 0.1))


def test_a_robot_may_turn_before_it_drives(world):
    world.reset(OPEN, 0.0)
    state = world.step(0.5, math.pi / 2 * 10, turns_first=True)
    assert state.xy == pytest.approx((2.0, 1.65), abs=1e-12)
    assert state.yaw == pytest.approx(math.pi / 2)
    world.reset((2.0, 0.2), 0.0)
    state = world.step(0.5, -math.pi / 2 * 10, turns_first=True)
    assert state.xy == pytest.approx((2.0, REACH), abs=1e-4)
    assert state.is_collision


def test_an_arc_in_small_steps_is_the_arc_in_the_open(small_scene):
    # Beside a wall, without touching it, the robot moves in small steps.
    world = World(small_scene, ROBOT)
    world.reset((2.0, REACH + 0.04), 0.0)
    near = world.step(0.5, 1.0)
    world.reset(OPEN, 0.0)
    far = world.step(0.5, 1.0)
    world.close()
    moved = [(s.xy[0] - 2.0, s.xy[1] - y) for s, y in ((near, REACH + 0.04), (far, OPEN[1]))]
    assert moved[0] == pytest.approx(moved[1], abs=1e-7)
    assert not near.is_collision


def test_states_do_not_depend_on_what_came_before(small_scene, contacts, world):
    rng = np.random.default_rng(5)
    actions = [(rng.uniform(0, 0.5), rng.uniform(-1.5, 1.5)) for _ in range(150)]
    drive(world, actions[::-1], start=(5.0, 2.5), yaw=2.0)
    used = drive(world, actions, yaw=0.4)
    fresh_world = World(small_scene, ROBOT, contacts=contacts)
    fresh = drive(fresh_world, actions, yaw=0.4)
    fresh_world.close()
    assert used == fresh
    assert any(s.is_collision for s in used)


def test_the_robot_is_not_put_into_obstacles(world):
    with pytest.raises(ValueError, match=r"cannot stand at \(2\.20, 0\.90\): the place is taken"):
        world.reset((2.2, 0.9), 0.0)


@settings(max_examples=200, deadline=None)
@given(
    wanted=st.tuples(*[st.floats(-0.1, 0.1)] * 2),
    angles=st.lists(st.floats(0, 2 * math.pi), max_size=4),
    room=st.floats(0, 0.05),
)
def test_slide_stays_before_every_plane_and_goes_no_further_than_wanted(wanted, angles, room):
    wanted = np.array(wanted)
    normals = np.array([(math.cos(a), math.sin(a)) for a in angles]).reshape(-1, 2)
    moved = slide(wanted, normals, np.full(len(angles), room))
    assert (-(normals @ moved) <= room + 1e-9).all()
    assert np.linalg.norm(moved) <= np.linalg.norm(wanted) + 1e-9


def test_baked_home_is_at_rest_and_made_once():
    home = open_scenes(ScenesConfig()).load("Rowan_0")
    assert open_scenes(ScenesConfig()).load("Rowan_0") is home
    raw = make_home("Rowan_0", seed=0)
    loose = [(a, b) for a, b in zip(raw.objects, home.objects, strict=True) if not a.is_fixed]
    assert loose
    assert all(np.allclose(a.position, b.position, atol=0.1) for a, b in loose)
    assert all(a == b for a, b in zip(raw.objects, home.objects, strict=True) if a.is_fixed)
