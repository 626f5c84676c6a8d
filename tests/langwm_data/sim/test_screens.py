"""A wall hides what lies wholly behind it, and nothing of which any pixel shows a thing."""

import dataclasses

import numpy as np
import pytest

from langwm_data.config import CameraConfig
from langwm_data.scenes.geometry import yaw_quat
from langwm_data.scenes.homes import Homes
from langwm_data.scenes.spec import PartSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.render_embree import RayCaster
from langwm_data.sim.scene_mesh import scene_mesh
from langwm_data.sim.screens import make_screens
from langwm_data.sim.shading import pixel_to_ray

WALL = PartSpec(shape="box", size=(4.0, 0.2, 2.5), position=(0.0, 2.0, 1.25), slot=0)
CAMERA = Camera.on_robot(CameraConfig(), (0.0, 0.0), np.pi / 2)


def is_hidden(center, half=(0.2, 0.2, 0.2), wall=WALL, camera=CAMERA):
    screens = make_screens([(0, wall)])
    return bool(screens.hidden(camera, np.ones(1, np.bool_), np.array([center]), np.array([half]))[0])


def test_a_box_in_the_shadow_is_hidden_and_no_other():
    assert is_hidden((0.0, 4.0, 0.5))
    assert is_hidden((3.0, 4.0, 0.5))
    assert not is_hidden((3.9, 4.0, 0.5)), "sticks out at the side"
    assert not is_hidden((0.0, 4.0, 4.6)), "sticks out above"
    assert not is_hidden((0.0, 1.0, 0.5)), "stands before the wall"
    assert not is_hidden((0.0, 2.1, 0.5)), "sticks in the wall"
    assert not is_hidden((0.0, -4.0, 0.5)), "stands behind the camera"


def test_both_sides_and_turned_walls_cast_shadows():
    behind = Camera.on_robot(CameraConfig(), (0.0, 4.0), -np.pi / 2)
    assert is_hidden((0.0, 0.0, 0.5), camera=behind)
    assert not is_hidden((0.0, 4.5, 0.5), camera=behind)
    turned = PartSpec(
        shape="box", size=(4.0, 0.2, 2.5), position=(2.0, 0.0, 1.25), slot=0, orientation=yaw_quat(np.pi / 2)
    )
    assert is_hidden((4.0, 0.0, 0.5), wall=turned)
    assert not is_hidden((0.0, 4.0, 0.5), wall=turned)


@pytest.mark.parametrize("y", [1.95, 1.75])
def test_a_wall_around_the_eye_or_its_near_plane_hides_nothing(y):
    assert not is_hidden((0.0, 4.0, 0.5), camera=Camera.on_robot(CameraConfig(), (0.0, y), np.pi / 2))


def test_what_is_left_out_is_hit_by_no_ray():
    home = Homes(0).make("Rowan_0")
    mesh, rng = scene_mesh(home), np.random.default_rng(0)
    open_mesh = dataclasses.replace(mesh, screens=make_screens([]))
    rects, caster, num_hidden = np.array([room.rect for room in home.rooms]), RayCaster(mesh), 0
    for _ in range(40):
        low, high = np.split(rects[rng.integers(len(rects))], 2)
        camera = Camera.on_robot(CameraConfig(), tuple(rng.uniform(low, high)), float(rng.uniform(-3, 3)))
        drawn, in_view = (set(faces_of(m, camera).tolist()) for m in (mesh, open_mesh))
        assert drawn <= in_view
        y, x = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
        rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ pixel_to_ray(camera).T
        hit = np.unique(caster.faces(camera, rays.astype(np.float32)))
        assert not (in_view - drawn) & set(hit.tolist())
        num_hidden += len(in_view - drawn)
    assert num_hidden > 40 * 100


def faces_of(mesh, camera):
    return mesh.faces[mesh.visible_triangles(camera)[:, 0]]
