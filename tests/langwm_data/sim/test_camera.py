"""The pinhole camera: axes, units, and the way back from depth to points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from langwm_data.config import CameraConfig
from langwm_data.sim.camera import Camera


def make_camera(yaw: float = 0.0, pitch: float = 0.0) -> Camera:
    return Camera(
        height=128,
        width=160,
        vertical_fov_rad=math.radians(45),
        position=(1.0, 2.0, 0.3),
        yaw_rad=yaw,
        pitch_rad=pitch,
    )


def test_focal_length_at_the_papers_size_and_fov():
    camera = Camera.on_robot(CameraConfig(), (0.0, 0.0), 0.0)
    assert camera.focal_px == pytest.approx(154.51, abs=0.01)
    assert 2 * math.degrees(math.atan(80 / camera.focal_px)) == pytest.approx(54.75, abs=0.01)


def test_ahead_is_the_centre_left_is_left_and_up_is_up():
    camera = make_camera()
    ahead, left, above = camera.project(np.array([[4.0, 2.0, 0.3], [4.0, 3.0, 0.3], [4.0, 2.0, 1.0]]))
    assert ahead == pytest.approx([80, 64, 3])
    assert left[0] < 80
    assert left[1] == pytest.approx(64)
    assert above[1] < 64


def test_turning_left_moves_the_world_right():
    point = np.array([[4.0, 2.0, 0.3]])
    assert make_camera(yaw=0.1).project(point)[0, 0] > 80
    assert make_camera(pitch=0.1).project(point)[0, 1] > 64


@given(st.floats(-3.1, 3.1), st.floats(-1.0, 1.0), st.floats(0.2, 9.0))
def test_unproject_inverts_project(yaw, pitch, depth):
    camera = make_camera(yaw, pitch)
    points = camera.unproject(np.full((128, 160), depth, np.float32))
    pixels = camera.project(points[[0, 64, 127], [0, 80, 159]])
    assert pixels == pytest.approx(
        np.array([[0.5, 0.5, depth], [80.5, 64.5, depth], [159.5, 127.5, depth]]), abs=1e-4
    )


@given(st.floats(-3.1, 3.1), st.floats(-1.0, 1.0))
def test_pose_is_a_right_handed_rotation(yaw, pitch):
    rotation = make_camera(yaw, pitch).camera_to_world[:3, :3]
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
