"""Convex hulls as parts: the same to everything that looks at them as the box or cylinder that they copy."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from langwm_data.config import CameraConfig, RobotConfig
from langwm_data.labels.amodal import amodal_extents, scene_solids
from langwm_data.scenes.geometry import axis_quat, part_polygon
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import IDENTITY, PartSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.collision import Solids
from langwm_data.sim.mesh import part_mesh
from langwm_data.sim.settle import settle
from langwm_data.sim.world import World

TURNED = axis_quat((0.0, 0.6, 0.8), 0.7)


def as_hull(box):
    half = np.array(box.size) / 2
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    points = tuple(tuple((half * c).tolist()) for c in corners)
    return dataclasses.replace(box, shape="hull", points=points)


def hulled(scene):
    """A scene whose boxes are hulls of eight points."""

    def change(part):
        return as_hull(part) if part.shape == "box" else part

    surfaces = tuple(dataclasses.replace(s, part=change(s.part)) for s in scene.surfaces)
    objects = tuple(dataclasses.replace(o, parts=tuple(change(p) for p in o.parts)) for o in scene.objects)
    return dataclasses.replace(scene, surfaces=surfaces, objects=objects)


def test_a_hull_has_the_faces_of_its_points():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(30, 3))
    size = tuple(np.ptp(points, axis=0).tolist())
    corners = tuple(map(tuple, points.tolist()))
    hull = PartSpec(shape="hull", size=size, position=(0, 0, 0), slot=0, points=corners)
    mesh = part_mesh(hull)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(ConvexHull(points).volume)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals[mesh.triangles[:, 0]], normal, atol=1e-9)
    # Along the surface, texture coordinates are metres.
    edge, on_texture = b - a, mesh.uvs[mesh.triangles[:, 1]] - mesh.uvs[mesh.triangles[:, 0]]
    np.testing.assert_allclose(np.linalg.norm(on_texture, axis=1), np.linalg.norm(edge, axis=1))


def test_a_box_made_a_hull_has_six_faces():
    box = PartSpec(shape="box", size=(0.4, 0.3, 0.2), position=(1, 2, 3), slot=0, orientation=TURNED)
    mesh = part_mesh(as_hull(box))
    assert mesh.num_faces == 6
    np.testing.assert_allclose(
        np.sort(np.unique(mesh.vertices.round(9), axis=0), axis=0),
        np.sort(np.unique(part_mesh(box).vertices.round(9), axis=0), axis=0),
    )


@pytest.mark.parametrize("orientation", [IDENTITY, TURNED])
def test_it_covers_the_same_ground(orientation):
    box = PartSpec(shape="box", size=(0.4, 0.3, 0.2), position=(1, 2, 3), slot=0, orientation=orientation)
    ours, its = (part_polygon((1.0, 0.0, 0.0), TURNED, p) for p in (as_hull(box), box))
    assert {tuple(p) for p in ours.round(9).tolist()} == {tuple(p) for p in its.round(9).tolist()}


def test_free_space_is_the_same(small_scene):
    grids = [FreeSpace.from_scene(s, robot=RobotConfig()).grid for s in (small_scene, hulled(small_scene))]
    assert np.array_equal(*grids)


def test_things_are_as_far_apart_and_robots_stop_at_the_same_place(small_scene):
    pytest.importorskip("pybullet")
    places = []
    for scene in (settle(small_scene), hulled(settle(small_scene))):
        world = World(scene, RobotConfig())
        world.reset((3.2, 0.5), math.pi)
        # Over the foot of the lamp, around its pole, to the wall.
        for _ in range(80):
            state = world.step(0.5, 0.0)
        places.append((*state.xy, state.is_collision))
        world.close()
    assert places[0][2]
    assert places[0] == pytest.approx(places[1], abs=0.003)


def test_gaps_between_neighbours_are_the_same(small_scene):
    pytest.importorskip("pybullet")
    found = []
    for scene in (small_scene, hulled(small_scene)):
        solids = Solids(scene)
        found.append({(i, j): gap.distance for i, j, gap in solids.iter_neighbours(0.02)})
        solids.close()
    assert found[0].keys() == found[1].keys()
    # Bullet gives hulls a margin of millimetres.
    for pair, distance in found[0].items():
        assert found[1][pair] == pytest.approx(distance, abs=0.004), pair


def test_silhouettes_are_the_same(small_scene):
    camera = Camera.on_robot(CameraConfig(), (3.0, 1.5), 2.8)
    numbers = dict.fromkeys(small_scene.instances(), 3)
    ours, its = (amodal_extents(scene_solids(s), camera, numbers) for s in (hulled(small_scene), small_scene))
    for number, extent in its.items():
        assert dataclasses.astuple(ours[number]) == pytest.approx(dataclasses.astuple(extent), abs=1e-3)
