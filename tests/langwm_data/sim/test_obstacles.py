"""Both ways to ask about obstacles: against dense points on outlines, and against each other."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from langwm_data.baking import open_scenes
from langwm_data.config import RobotConfig, ScenesConfig
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.sim.obstacles import MapObstacles, SolidObstacles, make_obstacles
from langwm_data.sim.world import World

ROBOT = RobotConfig()
TRIANGLE = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])


def as_points(polygon, num=4000):
    """Points on the outline, a fraction of a millimetre apart."""
    share = np.linspace(0, 1, num, endpoint=False)[:, None]
    return np.concatenate(
        [a + share * (b - a) for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)]
    )


def test_gap_of_an_outline_by_hand():
    ask = MapObstacles([TRIANGLE], radius_m=0.2)
    assert ask.gap(0, (0.5, -0.5), 1.0) == pytest.approx((0.3, 0.0, -1.0))
    assert ask.gap(0, (1.0, 1.0), 1.0) == pytest.approx(
        (math.sqrt(0.5) - 0.2, math.sqrt(0.5), math.sqrt(0.5))
    )
    assert ask.gap(0, (-0.3, -0.4), 1.0) == pytest.approx((0.3, -0.6, -0.8))
    assert ask.gap(0, (0.2, 0.1), 1.0) == pytest.approx((-0.3, 0.0, -1.0))
    assert ask.gap(0, (0.5, -0.5), 0.29) is None


def test_gap_of_an_outline_is_that_to_its_nearest_point():
    rng = np.random.default_rng(0)
    for sides in (3, 4, 16):
        angles = np.sort(rng.uniform(0, 2 * math.pi, sides))
        polygon = np.column_stack([np.cos(angles), 0.4 * np.sin(angles)])
        ask, tree = MapObstacles([polygon], radius_m=0.1), cKDTree(as_points(polygon))
        for xy in rng.uniform(-2, 2, (40, 2)):
            away, nearest = tree.query(xy)
            gap = ask.gap(0, tuple(xy), 10.0)
            if gap.distance > -0.1:
                assert gap.distance == pytest.approx(away - 0.1, abs=1e-3)
                direction = (xy - tree.data[nearest]) / away
                assert (gap.x, gap.y) == pytest.approx(tuple(direction), abs=0.02 / away)


def test_both_ways_give_the_same_gaps_to_upright_boxes(small_scene):
    walls = dataclasses.replace(small_scene, objects=small_scene.objects[3:4])
    solids, outlines = (make_obstacles(walls, ROBOT, way) for way in ("physics", "map"))
    rng, met = np.random.default_rng(1), 0
    for xy in rng.uniform((0.2, 0.2), (5.4, 2.8), (60, 2)):
        found = [
            sorted(gap for n in ask.near(tuple(xy), 0.3) if (gap := ask.gap(n, tuple(xy), 0.3)) is not None)
            for ask in (solids, outlines)
        ]
        assert len(found[0]) == len(found[1])
        for ours, theirs in zip(*found, strict=True):
            met += 1
            assert ours.distance == pytest.approx(theirs.distance, abs=1e-3)
            # PyBullet's directions are less exact than its distances.
            assert (ours.x, ours.y) == pytest.approx((theirs.x, theirs.y), abs=0.02)
    solids.close()
    assert met > 30


def test_near_names_all_that_are_near(small_scene):
    ask = make_obstacles(small_scene, ROBOT, "map")
    for xy in np.random.default_rng(2).uniform((0, 0), (6, 3), (30, 2)):
        near = ask.near(tuple(xy), 0.2)
        far = set(range(len(ask._edges))) - set(near)
        assert near == sorted(near)
        assert all(ask.gap(n, tuple(xy), 0.2) is None for n in far)


def test_where_the_map_has_room_physics_has():
    scene = open_scenes(ScenesConfig()).load("Alder_1")
    free = FreeSpace.from_scene(scene, robot=ROBOT)
    physics, outlines = (World(scene, ROBOT, contacts=way) for way in ("physics", "map"))
    rng, num_taken = np.random.default_rng(0), 0
    for _ in range(400):
        # Beside free places too, where the robot may or may not fit.
        xy = tuple((free.sample(rng) + rng.uniform(-0.1, 0.1, 2)).tolist())
        is_taken = physics.collides(xy, 0.0)
        num_taken += is_taken
        assert outlines.collides(xy, 0.0) or not is_taken
    physics.close()
    assert num_taken > 30


def test_what_the_robot_drives_over_or_under_is_no_obstacle(small_scene):
    solids = SolidObstacles(small_scene, ROBOT)
    names = small_scene.instances()
    met = {names[int(solids._solids.instances[n])].category for n in solids._numbers.tolist()}
    solids.close()
    # The lintel of the door, the table's top and what stands on it are above the robot.
    assert met == {"wall", "dining_table", "stool", "floor_lamp", "kitchen_cabinet"}
