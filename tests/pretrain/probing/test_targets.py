"""What features are asked for, beside plain loops over the same frames."""

import math
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from langwm_data.config import RobotConfig
from langwm_data.sim.camera import Camera
from pretrain.probing.features import choose_frames
from pretrain.probing.targets import (
    NOWHERE,
    categories_present,
    frequent_categories,
    nearest_obstacle,
    next_frames,
    room_kinds,
)

ROBOT = RobotConfig()


def frames_table(rows):
    names = ("scene", "camera_x", "camera_y", "trajectory", "step", "action", "key")
    usual = ("Alder_0", 1.0, 1.0, -1, 0, [0.0, 0.0])
    full = [(*row, *usual[len(row) :], f"key{i}") for i, row in enumerate(rows)]
    return pa.table({name: [row[n] for row in full] for n, name in enumerate(names)})


def test_rooms_are_those_in_which_cameras_stand(small_scene):
    other = replace(small_scene, name="Birch_0")
    table = frames_table([("Alder_0", 1.0, 1.0), ("Birch_0", 5.0, 2.9), ("Alder_0", 4.05, 1.4)])
    kinds = room_kinds(table, {"Alder_0": small_scene, "Birch_0": other})
    assert kinds == ["study", "hall", NOWHERE]


def test_categories_are_marked_frame_by_frame():
    held = [["bed", "chair", "chair"], [], ["sofa"]]
    np.testing.assert_array_equal(categories_present(held, ["chair", "sofa"]), [[1, 0], [0, 0], [0, 1]])


def test_categories_must_be_there_and_missing_often_enough():
    train = [["bed", "lamp"]] * 5 + [["bed"]] * 5
    test = [["bed", "lamp", "rug"]] * 2 + [[]] * 2
    assert frequent_categories(train, test, 3, 2) == ["lamp"]  # the bed is always there
    assert frequent_categories(train, test, 6, 2) == []
    assert frequent_categories(train, test, 3, 3) == []


@pytest.mark.parametrize("pitch_rad", [-0.3, 0.0, 0.2])
def test_nearest_obstacle_is_that_of_a_plain_loop(pitch_rad):
    rng = np.random.default_rng(1)
    camera = Camera(
        height=12,
        width=16,
        vertical_fov_rad=0.8,
        position=(2.0, -1.0, 0.3),
        yaw_rad=0.7,
        pitch_rad=pitch_rad,
    )
    depth = rng.uniform(0.3, 6, (12, 16))
    depth[rng.random((12, 16)) < 0.2] = 0
    away, bearing = math.inf, math.nan
    for place, z in zip(camera.unproject(depth).reshape(-1, 3), depth.ravel(), strict=True):
        x, y = place[:2] - camera.position[:2]
        in_way = ROBOT.clearance_m < place[2] < ROBOT.height_m
        if z > 0 and in_way and math.hypot(x, y) < away:
            away = math.hypot(x, y)
            bearing = math.remainder(math.atan2(y, x) - camera.yaw_rad, 2 * math.pi)
    found = nearest_obstacle(depth[None], camera.intrinsics, np.array([0.3]), np.array([pitch_rad]), ROBOT)
    np.testing.assert_allclose(found[0], [away, bearing], atol=1e-9)


def test_frames_that_show_no_obstacle_have_no_answer():
    depth = np.zeros((1, 4, 4))
    found = nearest_obstacle(depth, np.diag([4.0, 4.0, 1.0]), np.array([0.3]), np.array([0.0]), ROBOT)
    assert np.isnan(found).all()


def test_next_frames_are_of_the_same_drive():
    rows = [
        ("Alder_0", 0.0, 0.0, 3, 0, [0.0, 0.0]),
        ("Alder_0", 0.0, 0.0, 3, 2, [0.5, 0.1]),
        ("Alder_0", 0.0, 0.0, 3, 1, [1.0, -0.2]),
        ("Birch_0", 0.0, 0.0, 3, 3, [0.9, 0.9]),
        ("Alder_0", 0.0, 0.0, -1, 3, [0.8, 0.8]),
    ]
    pairs, actions = next_frames(frames_table(rows))
    found = {tuple(pair): action for pair, action in zip(pairs.tolist(), actions.tolist(), strict=True)}
    assert found == {(0, 2): [1.0, -0.2], (2, 1): [0.5, 0.1]}


def test_of_a_drive_all_frames_are_chosen_or_none():
    table = frames_table([("Alder_0", 0.0, 0.0, i // 5, i % 5) for i in range(50)])
    chosen = choose_frames(np.random.default_rng(0), table, 18)
    assert len(chosen) == 20
    assert all(sum(n // 5 == drive for n in chosen) in (0, 5) for drive in range(10))
    single = frames_table([("Alder_0",)] * 50)
    assert len(choose_frames(np.random.default_rng(0), single, 18)) == 18
    assert choose_frames(np.random.default_rng(0), single, 999) == list(range(50))
