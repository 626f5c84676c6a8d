"""Light and level of detail against geometry worked out another way."""

import numpy as np
import pytest

from langwm_data.config import CameraConfig, LightsConfig
from langwm_data.sim.camera import Camera
from langwm_data.sim.lights import SUN_DIRECTION, Lights
from langwm_data.sim.shading import MAX_STRETCH, level_of_detail, light, pixel_to_ray

UP = np.float32([[0], [0], [1]])
LAMP_ONLY = LightsConfig(ambient=0, sun=0, lamp=0.6)


def lit(normal, to_lamp, lights):
    normal, to_lamp = np.float32(normal).reshape(3, 1), np.float32(to_lamp).reshape(3, 1)
    red, green, blue = light(normal, to_lamp, Lights.of(lights))[:, 0].tolist()
    assert red == green == blue
    return red


def test_the_direction_of_the_sun_has_unit_length():
    assert np.linalg.norm(SUN_DIRECTION) == pytest.approx(1, abs=2e-3)


def test_light_never_exceeds_one():
    assert lit((0, 0, 1), (0, 0, 0.5), LightsConfig(ambient=5, sun=5, lamp=5)) == 1


def test_a_lamp_lights_what_is_near_and_turned_towards_it():
    near, far = lit((0, 0, 1), (0, 0, 1.5), LAMP_ONLY), lit((0, 0, 1), (0, 0, 4), LAMP_ONLY)
    aslant, away = lit((1, 0, 0), (0, 0, 1.5), LAMP_ONLY), lit((0, 0, -1), (0, 0, 1.5), LAMP_ONLY)
    assert 0.6 >= near > far > 0
    assert near > aslant > away == 0


def test_surfaces_of_all_directions_differ_without_a_lamp():
    lights = LightsConfig(lamp=0)
    levels = sorted(lit(n, (0, 0, 1), lights) for n in [*np.eye(3), *-np.eye(3)])
    assert np.diff(levels).min() > 0.01


@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.2, 1.4])
def test_level_lies_between_the_sides_of_the_pixel_s_footprint(tilt):
    # The floor's point under each of three neighbouring pixels, by intersecting rays with the plane.
    camera = Camera.on_robot(CameraConfig(), (0.0, 0.0), 0.0)
    to_ray = pixel_to_ray(camera)
    normal = np.array([-np.cos(tilt), 0.0, np.sin(tilt)])
    pixels = np.array([(80.5, 64.5), (81.5, 64.5), (80.5, 65.5)])
    rays = np.column_stack([pixels, np.ones(3)]) @ to_ray.T
    depth = 3 * (normal @ (1, 0, 0)) / (rays @ normal)
    points = rays * depth[:, None]
    footprint = np.linalg.svd(points[1:] - points[0], compute_uv=False)
    level = level_of_detail(
        np.float32(normal).reshape(3, 1), np.float32(rays[:1].T), np.float32(depth[:1]), 128 / camera.focal_px
    )
    short, long = sorted(np.log2(128 * footprint))
    assert short - 0.05 <= level[0] <= long + 0.05
    assert level[0] == pytest.approx((short + long) / 2, abs=0.1)


def test_level_is_bounded_at_grazing_angles():
    ray = np.float32([[1], [0], [0]])
    grazing = level_of_detail(UP, ray, np.float32([1]), 1.0)
    assert grazing[0] == pytest.approx(np.log2(MAX_STRETCH) / 2)


def test_rays_pass_through_what_the_camera_projects():
    camera = Camera(
        height=48, width=64, vertical_fov_rad=1.0, position=(1.0, 2.0, 0.5), yaw_rad=0.7, pitch_rad=0.2
    )
    point = np.array([[3.0, 3.5, 1.1]])
    x, y, z = camera.project(point)[0]
    np.testing.assert_allclose(pixel_to_ray(camera) @ (x, y, 1) * z + camera.position, point[0], atol=1e-9)
