import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.config import RobotConfig
from langwm_data.scenes.geometry import point_polygon_distance
from langwm_data.scenes.homes import make_home
from langwm_data.scenes.navigation import FreeSpace, floor_plan, obstacle_polygons
from langwm_data.scenes.spec import (
    IDENTITY,
    MaterialRef,
    MaterialSlot,
    ObjectSpec,
    PartSpec,
    RoomSpec,
    SceneSpec,
    SurfaceSpec,
)
from langwm_data.sim.world import World

ROBOT = RobotConfig(radius_m=0.2, height_m=0.45)


def block(low, high):
    size = tuple(float(b - a) for a, b in zip(low, high, strict=True))
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    return PartSpec(shape="box", size=size, position=middle, slot=0)


def room_scene(width, depth, blocks=(), objects=()):
    """A room with walls around it and some more pieces of wall in it."""
    t, h = 0.1, 2.5
    walls = [
        block((-t, -t, 0), (width + t, 0, h)),
        block((-t, depth, 0), (width + t, depth + t, h)),
        block((-t, 0, 0), (0, depth, h)),
        block((width, 0, 0), (width + t, depth, h)),
        *(block(*b) for b in blocks),
    ]
    return SceneSpec(
        name="room_0",
        building="room",
        floor=0,
        split="train",
        height_m=h,
        rooms=(RoomSpec(name="hall", kind="hallway", rect=(0.0, 0.0, width, depth)),),
        doorways=(),
        surfaces=tuple(SurfaceSpec(instance=1, kind="wall", room="hall", part=w) for w in walls),
        objects=objects,
        slots=(MaterialSlot(name="wall", categories=("paint",)),),
        palette=(MaterialRef(category="paint", id=1),),
    )


def table_at(x, y, z):
    top = PartSpec(shape="box", size=(1.0, 1.0, 0.04), position=(0, 0, z), slot=0)
    return ObjectSpec(
        instance=2,
        category="dining_table",
        model="dining_table_01",
        room="hall",
        position=(x, y, 0.0),
        orientation=IDENTITY,
        size=(1.0, 1.0, 1.0),
        parts=(top,),
    )


OPEN = FreeSpace.from_scene(room_scene(6.0, 4.0), robot=ROBOT)
# A wall from the lower side up to y = 3 in the middle of the room.
DIVIDED = FreeSpace.from_scene(room_scene(6.0, 4.0, [((2.9, 0, 0), (3.1, 3.0, 2.5))]), robot=ROBOT)


def around_the_wall(a, b):
    """The exact shortest way over the divided room: straight lines and arcs of the robot's radius."""
    corners = [np.array([2.9, 3.0]), np.array([3.1, 3.0])]
    total, r = 0.0, ROBOT.radius_m
    for point, corner in zip((a, b), corners, strict=True):
        away = np.linalg.norm(np.subtract(point, corner))
        slope = math.atan2(corner[1] - point[1], abs(corner[0] - point[0]))
        tangent = slope + math.asin(r / away)
        total += math.sqrt(away**2 - r**2) + r * max(tangent, 0.0)
    return total + 0.2


@settings(max_examples=40, deadline=None)
@given(st.floats(0.3, 5.7), st.floats(0.3, 3.7), st.floats(0.3, 5.7), st.floats(0.3, 3.7))
def test_distance_in_an_open_room_is_the_straight_line(ax, ay, bx, by):
    distance = OPEN.distance_field((ax, ay)).distance((bx, by))
    straight = math.hypot(ax - bx, ay - by)
    assert straight - 0.002 <= distance <= straight + 0.011


@pytest.mark.parametrize(("a", "b"), [((1, 1), (5, 1)), ((2, 0.5), (4, 2.5)), ((0.5, 2.9), (3.6, 0.4))])
def test_distance_around_a_wall_is_at_most_three_percent_too_long(a, b):
    exact = around_the_wall(a, b)
    assert exact - 0.01 <= DIVIDED.distance_field(a).distance(b) <= 1.03 * exact + 0.02


def test_distance_is_the_same_in_both_directions():
    a, b = (1.03, 0.77), (4.91, 1.33)
    forth, back = DIVIDED.distance_field(a).distance(b), DIVIDED.distance_field(b).distance(a)
    assert forth == pytest.approx(back, rel=0.02)


def test_distance_changes_continuously_along_a_path():
    field = DIVIDED.distance_field((5.0, 1.0))
    way = field.path((1.0, 1.0))
    fine = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(way)])
    steps = np.abs(np.diff([field.distance(p) for p in fine]))
    lengths = np.linalg.norm(np.diff(fine, axis=0), axis=1)
    assert (steps <= 1.5 * lengths + 1e-3).all()


def test_distance_is_not_quantised():
    field = OPEN.distance_field((5.0, 2.0))
    steps = -np.diff([field.distance((1.0 + 0.05 * i, 2.02)) for i in range(40)])
    assert np.allclose(steps, 0.05, atol=0.002)


def test_path_is_as_long_as_the_distance_and_free():
    field = DIVIDED.distance_field((5.0, 1.0))
    path = field.path((1.0, 1.0))
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length == pytest.approx(field.distance((1.0, 1.0)), abs=0.1)
    assert all(DIVIDED.clearance(p) >= ROBOT.radius_m - 0.05 for p in path)
    assert np.allclose(path[0], (1, 1))
    assert np.allclose(path[-1], (5, 1))


def test_a_robot_that_touches_a_wall_still_has_a_distance():
    field = OPEN.distance_field((5.0, 2.0))
    assert field.distance((0.2, 2.0)) == pytest.approx(4.8, abs=0.02)
    assert field.distance((0.205, 0.205)) == pytest.approx(math.hypot(4.795, 1.795), abs=0.05)


def test_a_robot_deep_in_a_slot_barely_wider_than_itself_still_has_a_distance():
    blocks = [((0, 0, 0), (1.5, 1.887, 2.5)), ((0, 2.293, 0), (1.5, 4.0, 2.5))]
    space = FreeSpace.from_scene(room_scene(6.0, 4.0, blocks), robot=ROBOT, resolution_m=0.1)
    assert not space.is_free((0.5, 2.09))
    assert space.distance_field((5.0, 2.09)).distance((0.5, 2.09)) == pytest.approx(4.5, abs=0.15)


def test_only_the_largest_area_counts_and_the_rest_is_unreachable():
    space = FreeSpace.from_scene(room_scene(6.0, 4.0, [((2.4, 0, 0), (2.5, 4.0, 2.5))]), robot=ROBOT)
    assert space.is_free((4, 2))
    assert not space.is_free((1, 2))
    field = space.distance_field((4.0, 2.0))
    assert field.distance((1.0, 2.0)) == math.inf
    with pytest.raises(
        ValueError, match=r"\(1.00, 2.00\) has no way to the goal; allowed: points in the free"
    ):
        field.path((1.0, 2.0))
    with pytest.raises(ValueError, match=r"goal \(1.00, 2.00\) is not free; allowed: points where the robot"):
        space.distance_field((1.0, 2.0))


def test_the_robot_does_not_squeeze_through_a_gap_narrower_than_itself():
    def gap(width):
        blocks = [((2.9, 0, 0), (3.1, 2.0, 2.5)), ((2.9, 2.0 + width, 0), (3.1, 4.0, 2.5))]
        return FreeSpace.from_scene(room_scene(6.0, 4.0, blocks), robot=ROBOT)

    assert gap(0.9).area_m2 > 1.7 * gap(0.38).area_m2


def test_clearance_is_the_distance_to_the_nearest_thing():
    assert OPEN.clearance((1.0, 2.0)) == pytest.approx(1.0)
    assert OPEN.clearance((3.0, 2.0)) == pytest.approx(2.0)
    assert DIVIDED.clearance((2.9 - 0.3, 3.4)) == pytest.approx(0.5)
    assert DIVIDED.clearance((3.0, 1.0)) == 0.0


def test_free_means_the_robots_whole_body_is_free():
    assert OPEN.is_free((0.2501, 2.0))
    assert not OPEN.is_free((0.19, 2.0))
    assert not OPEN.is_free((-3.0, 50.0))


def test_samples_are_free_and_cover_the_area_evenly():
    rng = np.random.default_rng(0)
    points = np.array([OPEN.sample(rng) for _ in range(1500)])
    assert all(OPEN.is_free(p) for p in points[:100])
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=(3, 2), range=((0.2, 5.8), (0.2, 3.8)))
    assert ((counts - 250) ** 2 / 250).sum() < 20.5  # chi-square, 5 degrees of freedom, p = 0.001
    assert np.array_equal(OPEN.sample(np.random.default_rng(3)), OPEN.sample(np.random.default_rng(3)))


@pytest.mark.parametrize(("z", "is_free"), [(0.3, False), (0.7, True), (-0.01, True)])
def test_only_what_the_robot_would_hit_is_in_its_way(z, is_free):
    space = FreeSpace.from_scene(room_scene(6.0, 4.0, objects=(table_at(3.0, 2.0, z),)), robot=ROBOT)
    assert space.is_free((3.0, 2.0)) == is_free


def test_a_room_smaller_than_the_robot_is_refused():
    with pytest.raises(ValueError, match=r"scene 'room_0' has no room for a robot of radius 0.2 m; allowed:"):
        FreeSpace.from_scene(room_scene(0.3, 0.3), robot=ROBOT)


def test_finer_cells_agree_with_coarse_ones():
    fine = FreeSpace.from_scene(
        room_scene(6.0, 4.0, [((2.9, 0, 0), (3.1, 3.0, 2.5))]), robot=ROBOT, resolution_m=0.05
    )
    a, b = (1.0, 1.0), (5.0, 1.0)
    exact = around_the_wall(a, b)
    assert fine.distance_field(a).distance(b) == pytest.approx(exact, rel=0.03)


def test_floor_plan_draws_floors_first_and_walls_last():
    scene = make_home("Rowan_0", seed=0)
    shapes = floor_plan(scene)
    names = [category for category, _ in shapes]
    assert names[: len(scene.rooms)] == ["floor"] * len(scene.rooms)
    assert names[-1] == "wall"
    assert "ceiling" not in names
    assert {"door", "window"} <= set(names)
    assert all(polygon.ndim == 2 and polygon.shape[1] == 2 for _, polygon in shapes)


def test_floor_plan_leaves_doorways_open():
    scene = make_home("Rowan_0", seed=0)
    walls = [polygon for category, polygon in floor_plan(scene) if category == "wall"]
    for doorway in scene.doorways:
        middle = np.array([doorway.center])
        assert all(point_polygon_distance(middle, wall)[0] > 0.2 for wall in walls)


def test_obstacles_leave_out_rugs_and_ceiling_lamps():
    scene = make_home("Rowan_0", seed=0)
    kept = len(obstacle_polygons(scene, RobotConfig()))
    assert 0 < kept < sum(1 for _ in scene.iter_parts())
    assert len(obstacle_polygons(scene, RobotConfig(height_m=2.4))) > kept


@pytest.mark.parametrize(("height", "is_free"), [(0.025, True), (0.035, False)])
def test_what_the_robot_drives_over_is_what_the_world_lets_it_drive_over(height, is_free):
    scene = room_scene(4.0, 3.0, [((1.0, 1.0, 0.0), (2.0, 2.0, height))])
    free, world = FreeSpace.from_scene(scene, robot=ROBOT), World(scene, ROBOT)
    assert free.is_free((1.5, 1.5)) == is_free
    assert world.collides((1.5, 1.5), 0.0) != is_free
    world.close()
