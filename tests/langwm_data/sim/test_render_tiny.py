"""TinyRenderer's frames against ray casting, known distances and known sides."""

import dataclasses
import math
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.scenes.spec import MaterialRef
from langwm_data.sim import bullet, texture
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
from langwm_data.sim.render_tiny import TinyRenderer

SMALL = CameraConfig(height=64, width=80)
VIEWS = [((3.5, 0.4), 2.4), ((0.5, 1.5), 0.1), ((2.0, 2.0), -1.2), ((3.0, 1.45), 0.05)]
OTHER_PALETTE = ("bricks/01", "tiles/02", "plaster/02", "planks/01", "leather/01", "metal/04")


def view(xy, yaw, **changes):
    return dataclasses.replace(Camera.on_robot(SMALL, xy, yaw), **changes)


def palette(texts):
    return tuple(MaterialRef.parse(text) for text in texts)


def same(a, b):
    return all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("rgb", "depth", "instance"))


@pytest.fixture(scope="module")
def renderer(small_scene):
    renderer = TinyRenderer(RenderConfig())
    renderer.load(small_scene)
    yield renderer
    renderer.close()
    renderer.close()


@pytest.mark.parametrize(("xy", "yaw"), VIEWS)
def test_depth_and_ids_agree_with_ray_casting(renderer, ray_caster, xy, yaw):
    camera = view(xy, yaw, pitch_rad=0.1)
    frame = renderer.render(camera)
    depth, instance = ray_caster(camera)
    assert (frame.instance == instance).mean() > 0.999
    error = np.abs(frame.depth - depth)[frame.instance == instance]
    assert np.median(error) < 1e-4
    # Bullet's rays slip between coplanar triangles now and then.
    assert (error < 1e-3).mean() > 0.999


def test_depth_of_a_facing_wall_is_its_distance_in_every_pixel(renderer):
    frame = renderer.render(view((2.0, 1.2), -math.pi / 2))
    wall = frame.depth[frame.instance == 10]
    assert len(wall) > 1000
    np.testing.assert_allclose(wall, 1.2, atol=1e-4)


def test_wall_just_before_the_camera_fills_the_picture(renderer):
    frame = renderer.render(view((2.0, 0.1), -math.pi / 2, position=(2.0, 0.1, 1.5)))
    assert (frame.instance == 10).all()
    np.testing.assert_allclose(frame.depth, 0.1, atol=1e-4)


def test_left_is_left(renderer):
    # The stool stands at smaller y than the camera: to the right when looking along +x.
    columns = np.arange(SMALL.width)
    towards = renderer.render(view((0.2, 1.3), 0.0)).instance == 31
    away = renderer.render(view((3.8, 1.3), math.pi)).instance == 31
    assert (towards.sum(axis=0) @ columns) / towards.sum() > SMALL.width / 2
    assert (away.sum(axis=0) @ columns) / away.sum() < SMALL.width / 2


def test_pixels_lie_where_the_camera_projects_points(small_scene, renderer):
    camera = view((0.5, 1.5), -0.3, height=512, width=640)
    instance = renderer.render(camera).instance
    (stool,) = [o for o in small_scene.objects if o.instance == 31]
    (center,) = camera.project(np.array([np.add(stool.position, (0, 0, 0.42))]))
    _, xs = np.nonzero(instance == 31)
    assert (xs.mean() + 0.5) == pytest.approx(center[0], abs=1.0)
    assert instance[int(center[1]), int(center[0])] == 31


QUADRANTS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_textures_on_walls_are_upright_metric_and_not_mirrored(small_scene, monkeypatch, yaw):
    picture = QUADRANTS.repeat(64, axis=0).repeat(64, axis=1)
    monkeypatch.setattr(texture, "texture_image", lambda ref, size: picture)
    monkeypatch.setattr(texture, "tile_size_m", lambda category: 1.0)
    renderer = make_renderer(RenderConfig(backend="tiny"))
    renderer.load(small_scene)
    camera = view((2.0, 1.5), yaw, position=(2.0, 1.5, 1.6))
    frame = renderer.render(camera)
    renderer.close()
    points = camera.unproject(frame.depth)
    # To the right along the wall and upwards, in metres.
    u, v = points @ camera.camera_to_world[:3, 0], points[..., 2]
    row, column = ((1 - v % 1) >= 0.5).astype(int), ((u % 1) >= 0.5).astype(int)
    inside = (np.abs(u % 0.5 - 0.25) < 0.22) & (np.abs(v % 0.5 - 0.25) < 0.22) & (frame.instance == 10)
    assert inside.sum() > 1000
    expected = QUADRANTS[row, column][inside] > 128
    np.testing.assert_array_equal(frame.rgb[inside] > 128, expected)


def test_directions_of_surfaces_differ_in_brightness(small_scene, monkeypatch):
    monkeypatch.setattr(texture, "texture_image", lambda ref, size: np.full((size, size, 3), 200, np.uint8))
    renderer = TinyRenderer(RenderConfig())
    renderer.load(small_scene)
    looks = [(0, 0.0), (math.pi / 2, 0.0), (math.pi, 0.0), (-math.pi / 2, 0.0), (0.0, 1.5), (0.0, -1.5)]
    middles = [
        int(renderer.render(view((2.9, 2.2), yaw, pitch_rad=pitch)).rgb[32, 40, 0]) for yaw, pitch in looks
    ]
    renderer.close()
    walls = sorted(middles[:4])
    assert np.diff(walls).min() >= 8
    assert 100 < min(middles) < max(middles) <= 200


def test_nothing_there_is_black_and_has_neither_depth_nor_id(renderer):
    frame = renderer.render(view((-5.0, 0.0), math.pi))
    assert not frame.rgb.any()
    assert not frame.depth.any()
    assert not frame.instance.any()


def test_ids_reach_the_largest_that_a_mask_can_hold(small_scene):
    largest = 2**16 - 1
    objects = tuple(
        dataclasses.replace(o, instance=largest) if o.instance == 31 else o for o in small_scene.objects
    )
    renderer = TinyRenderer(RenderConfig())
    renderer.load(dataclasses.replace(small_scene, objects=objects))
    instance = renderer.render(view((0.5, 1.5), -0.3)).instance
    renderer.close()
    assert instance.dtype == np.uint16
    assert largest in instance
    assert 31 not in instance


def test_same_bytes_whatever_came_before(small_scene, renderer):
    camera = view(*VIEWS[0])
    first = renderer.render(camera)
    renderer.load(dataclasses.replace(small_scene, objects=small_scene.objects[:2]))
    renderer.render(view(*VIEWS[1]))
    renderer.load(small_scene.with_palette(palette(OTHER_PALETTE)))
    renderer.render(camera)
    renderer.load(small_scene)
    fresh = TinyRenderer(RenderConfig())
    fresh.load(small_scene)
    assert same(renderer.render(camera), first)
    assert same(fresh.render(camera), first)
    fresh.close()


def test_palette_changes_colours_only_and_as_loading_would(small_scene, renderer):
    camera = view(*VIEWS[0])
    before = renderer.render(camera)
    renderer.set_palette(palette(OTHER_PALETTE))
    after = renderer.render(camera)
    renderer.load(small_scene.with_palette(palette(OTHER_PALETTE)))
    assert same(renderer.render(camera), after)
    renderer.load(small_scene)
    assert not np.array_equal(before.rgb, after.rgb)
    assert np.array_equal(before.depth, after.depth)
    assert np.array_equal(before.instance, after.instance)
    assert same(renderer.render(camera), before)


def test_palette_of_the_wrong_length_is_refused(renderer):
    with pytest.raises(ValueError, match="palette has 2 materials; scene Alder_0 has 6 slots"):
        renderer.set_palette(palette(OTHER_PALETTE[:2]))


def test_loading_again_and_again_takes_no_more_memory(small_scene):
    def resident_mib():
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20

    few = dataclasses.replace(small_scene, objects=small_scene.objects[:2])
    renderer = TinyRenderer(RenderConfig(texture_px=32))
    sizes = []
    for i in range(60):
        renderer.load(few if i % 2 else small_scene)
        renderer.render(view(*VIEWS[0]))
        sizes.append(resident_mib())
    renderer.close()
    assert sizes[-1] - sizes[20] < 2.0


def test_frames_have_the_camera_s_size_and_their_types(renderer):
    frame = renderer.render(view((2.0, 1.5), 0.0, height=50, width=70))
    assert (frame.rgb.shape, frame.rgb.dtype) == ((50, 70, 3), np.uint8)
    assert (frame.depth.shape, frame.depth.dtype) == ((50, 70), np.float32)
    assert (frame.instance.shape, frame.instance.dtype) == ((50, 70), np.uint16)


def test_nothing_is_written_to_the_terminal_and_pybullet_is_imported_late(small_scene):
    code = """
import sys
import langwm_data.sim.render_tiny, langwm_data.sim.world
assert "pybullet" not in sys.modules
from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
renderer = make_renderer(RenderConfig(backend="tiny"))
renderer.load(SceneSpec.from_json(sys.stdin.read()))
renderer.render(Camera.on_robot(CameraConfig(), (2, 1), 0))
renderer.close()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], input=small_scene.to_json(), capture_output=True, text=True, check=True
    )
    assert done.stdout + done.stderr == ""


def test_missing_pybullet_is_explained(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(ValueError, match=r"needs the package pybullet, which has wheels up to Python 3\.11"):
        bullet.import_pybullet()
