"""What every renderer owes: known distances, known sides, the same bytes again, and the others' truth."""

import dataclasses
import hashlib
import logging
import math
import multiprocessing
import resource
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from backends import gl_opens

from langwm_data.baking import open_scenes
from langwm_data.config import (
    CameraConfig,
    LightsConfig,
    RandomizeConfig,
    RenderConfig,
    RobotConfig,
    ScenesConfig,
)
from langwm_data.config_io import ConfigError
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim import gl_device, render, render_embree, texture
from langwm_data.sim.camera import Camera
from langwm_data.sim.lights import Lights, sample_lights
from langwm_data.sim.render import describe_renderer, make_renderer, resolve_backend

SMALL = CameraConfig(height=64, width=80)
VIEWS = [((3.5, 0.4), 2.4), ((0.5, 1.5), 0.1), ((2.0, 2.0), -1.2), ((3.0, 1.45), 0.05)]
OTHER_PALETTE = ("bricks/01", "tiles/02", "plaster/02", "planks/01", "leather/01", "metal/04")


needs_gl = pytest.mark.skipif(not gl_opens(), reason="no EGL device opens on this machine")
GL = pytest.param("gl", marks=needs_gl)
FAST = [GL, "embree"]
ALL = [*FAST, "tiny"]


def view(xy, yaw, **changes):
    return dataclasses.replace(Camera.on_robot(SMALL, xy, yaw), **changes)


def palette(texts):
    return tuple(MaterialRef.parse(text) for text in texts)


def same(a, b):
    return all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("rgb", "depth", "instance"))


def loaded(backend, scene, **options):
    renderer = make_renderer(RenderConfig(**{"backend": backend, "texture_px": 32} | options))
    renderer.load(scene)
    return renderer


@pytest.fixture(params=ALL)
def renderer(request, small_scene):
    renderer = loaded(request.param, small_scene)
    yield renderer
    renderer.close()
    renderer.close()


@pytest.fixture(params=FAST)
def fast(request):
    return request.param


@pytest.fixture
def fresh_textures():
    """Textures that a test replaces are neither taken from other tests nor left to them."""

    def forget():
        render_embree._texture_store.cache_clear()
        gl_device._gl_device.cache_clear()

    forget()
    yield
    forget()


# Against geometry known by hand.


def test_a_facing_wall_is_as_far_as_it_is_in_every_pixel(renderer):
    frame = renderer.render(view((2.0, 1.2), -math.pi / 2))
    wall = frame.depth[frame.instance == 10]
    assert len(wall) > 1000
    np.testing.assert_allclose(wall, 1.2, atol=1e-4)


def test_left_is_left(renderer):
    # The stool stands at smaller y than the camera: to the right when looking along +x.
    columns = np.arange(SMALL.width)
    towards = renderer.render(view((0.2, 1.3), 0.0)).instance == 31
    away = renderer.render(view((3.8, 1.3), math.pi)).instance == 31
    assert (towards.sum(axis=0) @ columns) / towards.sum() > SMALL.width / 2
    assert (away.sum(axis=0) @ columns) / away.sum() < SMALL.width / 2


def test_up_is_up(renderer):
    instance = renderer.render(view((2.0, 1.5), 0.0, position=(2.0, 1.5, 1.3), vertical_fov_rad=2.0)).instance
    ceiling, floor = 12, 11
    assert instance[0, SMALL.width // 2] == ceiling
    assert instance[-1, SMALL.width // 2] == floor


def test_nothing_there_is_black_and_has_neither_depth_nor_id(renderer):
    frame = renderer.render(view((-5.0, 0.0), math.pi))
    assert not frame.rgb.any()
    assert not frame.depth.any()
    assert not frame.instance.any()


@pytest.mark.parametrize("limits", [{"near_m": 2.0}, {"far_m": 1.1}])
def test_nothing_is_drawn_before_the_near_plane_or_beyond_the_far_one(fast, small_scene, limits):
    camera = view((2.0, 1.2), -math.pi / 2, **limits)
    depth = loaded(fast, small_scene).render(camera).depth
    seen = depth[depth > 0]
    assert (seen >= camera.near_m - 1e-4).all()
    assert (seen <= camera.far_m + 1e-4).all()


@pytest.mark.parametrize("pitch", [0.1, -0.4])
@pytest.mark.parametrize(("xy", "yaw"), VIEWS)
def test_depth_and_ids_agree_with_ray_casting(fast, small_scene, ray_caster, xy, yaw, pitch):
    camera = view(xy, yaw, pitch_rad=pitch)
    frame = loaded(fast, small_scene).render(camera)
    depth, instance = ray_caster(camera)
    assert (frame.instance == instance).mean() > 0.999
    error = np.abs(frame.depth - depth)[frame.instance == instance]
    # Bullet's rays slip between coplanar triangles now and then.
    assert (error < 1e-3).mean() > 0.999


QUADRANTS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)


@pytest.mark.usefixtures("fresh_textures")
@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_textures_on_walls_are_upright_metric_and_not_mirrored(fast, small_scene, monkeypatch, yaw):
    picture = QUADRANTS.repeat(64, axis=0).repeat(64, axis=1)
    monkeypatch.setattr(texture, "texture_image", lambda ref, size: picture)
    monkeypatch.setattr(texture, "tile_size_m", lambda category: 1.0)
    camera = view((2.0, 1.5), yaw, position=(2.0, 1.5, 1.6))
    options = {"texture_px": 128, "lights": LightsConfig(ambient=2), "is_antialiased": False}
    frame = loaded(fast, small_scene, **options).render(camera)
    points = camera.unproject(frame.depth)
    # To the right along the wall and upwards, in metres.
    u, v = points @ camera.camera_to_world[:3, 0], points[..., 2]
    row, column = ((1 - v % 1) >= 0.5).astype(int), ((u % 1) >= 0.5).astype(int)
    inside = (np.abs(u % 0.5 - 0.25) < 0.2) & (np.abs(v % 0.5 - 0.25) < 0.2) & (frame.instance == 10)
    assert inside.sum() > 1000
    assert np.abs(frame.rgb[inside].astype(int) - QUADRANTS[row, column][inside]).max() <= 2


# Against one another.


@pytest.fixture(scope="module")
def home_views():
    """Two baked floors and a dozen views of each."""
    rng = np.random.default_rng(0)
    views = []
    for name in ("Elm_1", "Maple_0"):
        scene = open_scenes(ScenesConfig()).load(name)
        free = FreeSpace.from_scene(scene, robot=RobotConfig())
        places = [tuple(free.sample(rng).tolist()) for _ in range(12)]
        cameras = [Camera.on_robot(CameraConfig(), xy, float(rng.uniform(-np.pi, np.pi))) for xy in places]
        views.append((scene, cameras))
    return views


def frames(backend, home_views, **options):
    pictures = []
    renderer = make_renderer(RenderConfig(backend=backend, texture_px=64, **options))
    for scene, cameras in home_views:
        renderer.load(scene)
        pictures += [renderer.render(camera) for camera in cameras]
    renderer.close()
    return pictures


def agreement(ours, theirs, tolerance_m):
    """Share of equal ids, and of depths within the tolerance where ids are equal."""
    is_same = np.stack([a.instance == b.instance for a, b in zip(ours, theirs, strict=True)])
    error = np.stack([np.abs(a.depth - b.depth) for a, b in zip(ours, theirs, strict=True)])
    return is_same.mean(), (error[is_same] < tolerance_m).mean()


@needs_gl
def test_gl_and_embree_agree_on_homes(home_views):
    gl, embree = frames("gl", home_views), frames("embree", home_views)
    ids, depths = agreement(gl, embree, 0.002)
    assert ids >= 0.995
    assert depths >= 0.99
    difference = [np.abs(a.rgb.astype(int) - b.rgb).mean() for a, b in zip(gl, embree, strict=True)]
    assert np.mean(difference) < 0.5
    assert max(difference) < 2


def test_tiny_agrees_on_homes(fast, home_views):
    ids, depths = agreement(frames(fast, home_views), frames("tiny", home_views), 0.03)
    assert ids >= 0.97
    assert depths >= 0.95


def test_pictures_are_neither_dark_nor_burnt_out(fast, home_views):
    for frame in frames(fast, home_views):
        assert 20 < frame.rgb.mean() < 230
        assert (frame.rgb == 255).mean() < 0.02


# Colours.


def test_colours_are_antialiased_and_ids_and_depth_are_not(fast, home_views):
    ((scene, cameras), _) = home_views
    home = [(scene, cameras[:6])]
    plain, smooth = frames(fast, home, is_antialiased=False), frames(fast, home)
    fine = [(scene, [dataclasses.replace(c, height=8 * c.height, width=8 * c.width) for c in cameras[:6]])]
    before, after = [], []
    for a, b, c in zip(plain, smooth, frames(fast, fine, is_antialiased=False), strict=True):
        assert np.array_equal(a.instance, b.instance)
        assert np.array_equal(a.depth, b.depth)
        # The truth: the mean of 64 samples a pixel.
        truth = c.rgb.reshape(128, 8, 160, 8, 3).mean(axis=(1, 3))
        changed = (a.rgb != b.rgb).any(axis=2)
        before.append(np.abs(a.rgb - truth)[changed])
        after.append(np.abs(b.rgb - truth)[changed])
    assert len(np.concatenate(before)) > 0.01 * 6 * 128 * 160
    assert np.concatenate(after).mean() < 0.7 * np.concatenate(before).mean()


def test_lights_can_be_turned_down(fast, small_scene):
    camera = view(*VIEWS[0])
    means = []
    for lamp in (0.0, 0.3, 0.6):
        lights = LightsConfig(ambient=0.1, sun=0.1, lamp=lamp)
        means.append(loaded(fast, small_scene, lights=lights).render(camera).rgb.mean())
    assert np.diff(means).min() > 5


def test_coloured_lights_are_drawn_as_the_formula_says(fast, small_scene):
    # Under ambient light alone, with no sky to speak of on a wall, a channel scales with its light.
    camera = view(*VIEWS[0])
    renderer = loaded(fast, small_scene, is_antialiased=False)
    means = []
    for color in ((0.8, 0.8, 0.8), (0.8, 0.4, 0.2)):
        renderer.set_lights(Lights(ambient=color, sun=(0.0, 0.0, 0.0), lamp=(0.0, 0.0, 0.0)))
        means.append(renderer.render(camera).rgb.mean(axis=(0, 1)))
    np.testing.assert_allclose(means[1] / means[0], (1, 0.5, 0.25), atol=0.01)


def test_the_sun_lights_what_faces_it(fast, small_scene):
    camera = view(*VIEWS[0])
    renderer = loaded(fast, small_scene)
    means = []
    for sign in (1, -1):
        dark = (0.0, 0.0, 0.0)
        towards = tuple(-sign * camera.camera_to_world[:3, 2])
        renderer.set_lights(Lights(ambient=dark, sun=(0.9, 0.9, 0.9), lamp=dark, sun_direction=towards))
        means.append(renderer.render(camera).rgb.mean())
    assert means[0] > 2 * means[1]


def test_lights_change_colours_only_and_stay_for_the_next_scene(fast, small_scene):
    camera = view(*VIEWS[0])
    renderer = loaded(fast, small_scene)
    before = renderer.render(camera)
    lights = sample_lights(np.random.default_rng(0), LightsConfig(), RandomizeConfig())
    renderer.set_lights(lights)
    after = renderer.render(camera)
    assert not np.array_equal(before.rgb, after.rgb)
    assert np.array_equal(before.depth, after.depth)
    assert np.array_equal(before.instance, after.instance)
    renderer.load(small_scene)
    assert same(renderer.render(camera), after)
    renderer.set_lights(Lights.of(LightsConfig()))
    assert same(renderer.render(camera), before)


def test_tiny_refuses_other_lights():
    renderer = make_renderer(RenderConfig(backend="tiny"))
    with pytest.raises(ConfigError, match="'tiny' has lights of its own; allowed: gl, embree"):
        renderer.set_lights(Lights.of(LightsConfig()))
    renderer.close()


def test_palette_changes_colours_only_and_as_loading_would(fast, small_scene):
    camera = view(*VIEWS[0])
    renderer = loaded(fast, small_scene)
    before = renderer.render(camera)
    renderer.set_palette(palette(OTHER_PALETTE))
    after = renderer.render(camera)
    other = loaded(fast, small_scene.with_palette(palette(OTHER_PALETTE)))
    assert same(other.render(camera), after)
    assert not np.array_equal(before.rgb, after.rgb)
    assert np.array_equal(before.depth, after.depth)
    assert np.array_equal(before.instance, after.instance)


def test_palette_of_the_wrong_length_is_refused(renderer):
    with pytest.raises(ValueError, match="palette has 2 materials; scene Alder_0 has 6 slots"):
        renderer.set_palette(palette(OTHER_PALETTE[:2]))


# The same bytes.


def digest(frame):
    return hashlib.sha256(frame.rgb.tobytes() + frame.depth.tobytes() + frame.instance.tobytes()).hexdigest()


def render_elsewhere(backend, text):
    """What another process makes of ``VIEWS``; it has seen other materials before."""
    scene = SceneSpec.from_json(text)
    renderer = loaded(backend, scene.with_palette(palette(OTHER_PALETTE)))
    renderer.render(view(*VIEWS[1]))
    renderer.load(scene)
    return [digest(renderer.render(view(*v))) for v in VIEWS]


@pytest.mark.usefixtures("fresh_textures")
@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_same_bytes_in_another_process(fast, small_scene, method):
    renderer = loaded(fast, small_scene)
    own = [digest(renderer.render(view(*v))) for v in VIEWS]
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply(render_elsewhere, (fast, small_scene.to_json())) == own


def test_renderers_of_one_process_do_not_disturb_one_another(fast, small_scene):
    few = dataclasses.replace(small_scene, objects=small_scene.objects[:2])
    a, b = loaded(fast, small_scene), loaded(fast, few, texture_px=16)
    camera, other = view(*VIEWS[0]), view(*VIEWS[3], height=40, width=90)
    first, second = a.render(camera), b.render(other)
    for _ in range(3):
        assert same(a.render(camera), first)
        assert same(b.render(other), second)
    b.close()
    assert same(a.render(camera), first)
    a.load(few)
    a.load(small_scene)
    assert same(a.render(camera), first)


def test_every_thread_may_have_a_renderer(fast, small_scene):
    own, found = digest(loaded(fast, small_scene).render(view(*VIEWS[0]))), []
    thread = threading.Thread(
        target=lambda: found.append(digest(loaded(fast, small_scene).render(view(*VIEWS[0]))))
    )
    thread.start()
    thread.join()
    assert found == [own]


def test_loading_again_and_again_takes_no_more_memory(fast, small_scene):
    def resident_mib():
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20

    few = dataclasses.replace(small_scene, objects=small_scene.objects[:2])
    renderer = loaded(fast, small_scene)
    sizes = []
    for i in range(150):
        renderer.load(few if i % 2 else small_scene)
        renderer.render(view(*VIEWS[0]))
        sizes.append(resident_mib())
    assert sizes[-1] - sizes[50] < 2.0


# Form.


def test_frames_have_the_camera_s_size_and_their_types(renderer):
    frame = renderer.render(view((2.0, 1.5), 0.0, height=50, width=70))
    assert (frame.rgb.shape, frame.rgb.dtype) == ((50, 70, 3), np.uint8)
    assert (frame.depth.shape, frame.depth.dtype) == ((50, 70), np.float32)
    assert (frame.instance.shape, frame.instance.dtype) == ((50, 70), np.uint16)
    assert all(image.flags.writeable and image.flags.c_contiguous for image in vars(frame).values())


def test_ids_reach_the_largest_that_a_mask_can_hold(fast, small_scene):
    largest = 2**16 - 1
    objects = tuple(
        dataclasses.replace(o, instance=largest) if o.instance == 31 else o for o in small_scene.objects
    )
    scene = dataclasses.replace(small_scene, objects=objects)
    instance = loaded(fast, scene).render(view((0.5, 1.5), -0.3)).instance
    assert largest in instance
    assert 31 not in instance


def test_baked_scenes_are_rendered_without_pybullet_and_in_silence(fast, small_scene):
    code = f"""
import sys
sys.modules["pybullet"] = None
import langwm_data.sim.render_gl, langwm_data.sim.render_embree
assert "moderngl" not in sys.modules and "embreex" not in sys.modules
from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
renderer = make_renderer(RenderConfig(backend={fast!r}))
renderer.load(SceneSpec.from_json(sys.stdin.read()))
assert renderer.render(Camera.on_robot(CameraConfig(), (2, 1), 0)).instance.any()
renderer.close()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], input=small_scene.to_json(), capture_output=True, text=True, check=True
    )
    assert done.stdout + done.stderr == ""


# Choice.


@pytest.fixture
def fresh_choice():
    render._best_backend.cache_clear()
    yield
    render._best_backend.cache_clear()


@needs_gl
@pytest.mark.usefixtures("fresh_choice")
def test_auto_is_gl_where_it_opens_and_says_so(caplog):
    caplog.set_level(logging.INFO)
    assert resolve_backend(RenderConfig(backend="auto")).backend == "gl"
    assert make_renderer(RenderConfig(backend="auto")).name == "gl"
    assert [r.message for r in caplog.records if "renderer: gl; " in r.message]
    assert describe_renderer(RenderConfig(backend="auto")) == describe_renderer(RenderConfig(backend="gl"))


@pytest.mark.usefixtures("fresh_choice")
def test_auto_is_embree_where_gl_does_not_open_and_says_why(caplog):
    caplog.set_level(logging.INFO)
    config = RenderConfig(backend="auto", egl_device=99)
    assert resolve_backend(config).backend == "embree"
    assert make_renderer(config).name == "embree"
    assert describe_renderer(config).startswith("embree ")
    assert [r.message for r in caplog.records if "renderer: embree; field 'render.egl_device'" in r.message]


def test_a_device_that_does_not_open_is_refused():
    with pytest.raises(
        ConfigError, match=r"'render\.egl_device': value 99 opens no OpenGL .* embree neither"
    ):
        make_renderer(RenderConfig(backend="gl", egl_device=99))


@pytest.mark.parametrize("backend", ALL)
def test_descriptions_name_the_backend_and_its_version(backend):
    text = describe_renderer(RenderConfig(backend=backend))
    assert text.startswith(backend)
    assert any(letter.isdigit() for letter in text)
