"""Culling against ray casting, and what the flat arrays say of each face."""

import dataclasses

import numpy as np

from langwm_data.config import CameraConfig
from langwm_data.sim.camera import Camera
from langwm_data.sim.scene_mesh import LAMP_BELOW_CEILING_M, scene_mesh


def cameras(count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        camera = Camera.on_robot(CameraConfig(height=48, width=60), rng.uniform((0.3, 0.3), (5.8, 2.7)), 0)
        yaw, pitch = rng.uniform((-3.1, -0.9), (3.1, 0.9))
        yield dataclasses.replace(camera, yaw_rad=float(yaw), pitch_rad=float(pitch))


def test_everything_that_a_ray_hits_survives_culling(small_scene, ray_caster):
    mesh = scene_mesh(small_scene)
    for camera in cameras(12):
        kept = mesh.face_instance[mesh.faces[mesh.visible_triangles(camera)[:, 0]]]
        _, instance = ray_caster(camera)
        assert set(np.unique(instance)) - {0} <= set(kept.tolist())


def test_culling_leaves_out_what_is_behind_and_what_turns_away(small_scene):
    mesh = scene_mesh(small_scene)
    shares = [len(mesh.visible_triangles(camera)) / len(mesh.triangles) for camera in cameras(20)]
    assert 0.02 < np.mean(shares) < 0.3


def test_triangles_are_those_of_the_groups(small_scene, scene_groups):
    mesh = scene_mesh(small_scene)
    instances = mesh.face_instance[mesh.faces[mesh.triangles[:, 0]]]
    slots = mesh.face_texture[mesh.faces[mesh.triangles[:, 0]]]
    for group in scene_groups(small_scene):
        own = mesh.triangles[(instances == group.instance) & (slots == group.slot)]
        expected = group.mesh.vertices[group.mesh.triangles]
        np.testing.assert_allclose(mesh.vertices[own], expected, atol=1e-6)


def test_no_face_is_shared_and_zero_is_nothing(small_scene):
    mesh = scene_mesh(small_scene)
    assert mesh.faces.min() == 1
    assert mesh.faces.max() + 1 == len(mesh.face_instance) == len(mesh.face_texture) == len(mesh.face_lamp)
    assert mesh.face_instance[0] == 0
    assert (mesh.faces[mesh.triangles] == mesh.faces[mesh.triangles[:, :1]]).all()


def test_every_room_is_lit_by_its_own_lamp(small_scene):
    mesh = scene_mesh(small_scene)
    height = small_scene.height_m - LAMP_BELOW_CEILING_M
    for instance, middle in [(30, (2.0, 1.5)), (10, (2.0, 1.5)), (33, (5.1, 1.5)), (21, (5.1, 1.5))]:
        lamps = mesh.face_lamp[mesh.face_instance == instance]
        np.testing.assert_allclose(lamps, [(*middle, height)] * len(lamps), atol=1e-6)


def test_an_object_in_no_listed_room_is_lit_from_above(small_scene):
    objects = tuple(dataclasses.replace(o, room="cellar") for o in small_scene.objects)
    mesh = scene_mesh(dataclasses.replace(small_scene, objects=objects))
    lamps = mesh.face_lamp[mesh.face_instance == 31]
    np.testing.assert_allclose(lamps[:, :2], [small_scene.objects[1].position[:2]] * len(lamps), atol=1e-6)


def test_a_scene_is_made_ready_once_whatever_its_palette(small_scene):
    other = small_scene.with_palette(small_scene.palette[::-1])
    assert scene_mesh(small_scene) is scene_mesh(other)
