"""Single views in a scene small enough to know what can be seen from where."""

import dataclasses
import math

import numpy as np
import pytest

from langwm_data.config import CameraConfig, DatasetConfig, ViewsConfig
from langwm_data.config_io import ConfigError, build_config
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
from langwm_data.views import Sights, camera_space, draw_views, sample_yaw

CONFIG = DatasetConfig(cameras=ViewsConfig(uniform_fraction=0.0))
STUDY, HALL = (3.0, 1.5), (4.8, 0.4)


@pytest.fixture(scope="module")
def sights(small_scene):
    return Sights.of(small_scene)


def first_views(scene, config, number):
    space, sights = camera_space(scene, config), Sights.of(scene)
    rngs = [np.random.default_rng(seed) for seed in range(number)]
    return [next(draw_views(rng, space, sights, config, scene.name)) for rng in rngs]


def is_hidden(sights, eye, point, instance):
    return bool(sights.hidden(np.array(eye), np.array([point]), np.array([instance]))[0])


def test_what_a_wall_hides_is_not_in_sight(sights):
    cabinet = (5.85, 1.5, 0.6)
    assert is_hidden(sights, (3.0, 0.5, 0.3), cabinet, 33)  # behind the wall, the door is farther up
    assert not is_hidden(sights, (3.0, 1.45, 0.3), cabinet, 33)


def test_an_object_does_not_hide_itself(sights):
    assert not is_hidden(sights, (2.2, 1.9, 0.3), (2.2, 0.9, 0.2), 31)


def test_what_is_in_sight_does_not_depend_on_what_else_is_asked_for(sights):
    rng = np.random.default_rng(0)
    eye, aims = np.array([3.0, 0.5, 0.3]), rng.uniform((0, 0, 0), (6, 3, 2), (200, 3))
    instances = rng.choice(sights.objects, 200)
    together = sights.hidden(eye, aims, instances)
    assert 0 < together.sum() < 200
    alone = [is_hidden(sights, eye, *pair) for pair in zip(aims, instances, strict=True)]
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize("xy", [STUDY, HALL])
def test_views_are_turned_to_what_is_in_sight(small_scene, sights, xy):
    rng = np.random.default_rng(0)
    camera = CONFIG.camera
    half_fov = math.atan(math.tan(math.radians(camera.vertical_fov_deg) / 2) * camera.width / camera.height)
    objects = np.array([o.position[:2] for o in small_scene.objects])
    bearings = np.arctan2(*(objects - xy).T[::-1])
    for _ in range(50):
        yaw = sample_yaw(rng, sights, xy, CONFIG)
        assert yaw is not None
        assert min(abs(math.remainder(b - yaw, 2 * math.pi)) for b in bearings) < half_fov


def test_almost_every_first_view_shows_an_object(small_scene):
    objects = [o.instance for o in small_scene.objects]
    with_them = {}
    renderer = make_renderer(CONFIG.render)
    renderer.load(small_scene)
    for fraction in (0.0, 1.0):
        cameras = ViewsConfig(uniform_fraction=fraction)
        config = dataclasses.replace(CONFIG, cameras=cameras)
        seen = []
        for view in first_views(small_scene, config, 60):
            frame = renderer.render(Camera.on_robot(config.camera, view.xy, view.yaw_rad))
            area = np.isin(frame.instance, objects).mean()
            seen.append(area >= config.labels.min_area_fraction)
        with_them[fraction] = np.mean(seen)
    renderer.close()
    assert with_them[0.0] >= 0.95 > with_them[1.0] + 0.05


def test_uniform_views_look_everywhere(small_scene):
    config = dataclasses.replace(CONFIG, cameras=ViewsConfig(uniform_fraction=1.0))
    yaws = np.array([view.yaw_rad for view in first_views(small_scene, config, 400)])
    counts, _ = np.histogram(yaws, bins=8, range=(-math.pi, math.pi))
    assert ((counts - 50) ** 2 / 50).sum() < 24.3  # chi-squared with 7 degrees of freedom, p = 0.001


def test_a_uniform_view_is_taken_as_it_comes(small_scene):
    config = dataclasses.replace(CONFIG, cameras=ViewsConfig(uniform_fraction=1.0))
    space, sights = camera_space(small_scene, config), Sights.of(small_scene)
    assert len(list(draw_views(np.random.default_rng(0), space, sights, config, "Alder_0"))) == 1
    views = list(draw_views(np.random.default_rng(0), space, sights, CONFIG, "Alder_0"))
    assert len(views) == CONFIG.cameras.max_tries


@pytest.mark.parametrize("clearance_m", [0.06, 0.25, 0.4])
def test_cameras_stand_as_far_from_obstacles_as_asked(small_scene, clearance_m):
    config = dataclasses.replace(CONFIG, cameras=ViewsConfig(min_clearance_m=clearance_m))
    truth = FreeSpace.from_scene(small_scene, robot=config.robot)
    nearest = min(truth.clearance(view.xy) for view in first_views(small_scene, config, 150))
    assert clearance_m <= nearest < clearance_m + 0.1


def test_a_high_camera_keeps_clear_of_what_hangs_there(small_scene):
    # The table's top is above the robot, at 0.7 m: it can drive under, a camera at 0.75 m cannot.
    low = camera_space(small_scene, CONFIG)
    high = dataclasses.replace(CONFIG, camera=CameraConfig(mount_height_m=0.75))
    assert low.clearance((1.0, 2.4)) > 0
    assert camera_space(small_scene, high).clearance((1.0, 2.4)) == 0


@pytest.mark.parametrize("mode", ["single", "trajectory"])
def test_no_place_far_enough_is_a_wrong_request(small_scene, mode):
    config = dataclasses.replace(CONFIG, cameras=ViewsConfig(mode=mode, min_clearance_m=50.0))
    with pytest.raises(
        ConfigError, match=r"'cameras\.min_clearance_m': value 50\.0 leaves no place .* Alder_0"
    ):
        first_views(small_scene, config, 1)


def test_a_camera_in_the_wall_is_a_wrong_request():
    with pytest.raises(
        ConfigError, match=r"min_clearance_m 0\.01 must not be less than camera\.near_m 0\.05"
    ):
        build_config(DatasetConfig, {"cameras": {"min_clearance_m": 0.01}})


@pytest.mark.parametrize(
    ("palette", "length", "block"), [(25, 25, 25), (25, 10, 30), (20, 100, 100), (1, 7, 7)]
)
def test_a_block_holds_whole_trajectories(palette, length, block):
    values = {"frames_per_palette": palette, "trajectory_length": length}
    assert ViewsConfig(**values).frames_per_block == palette
    assert ViewsConfig(mode="trajectory", **values).frames_per_block == block
