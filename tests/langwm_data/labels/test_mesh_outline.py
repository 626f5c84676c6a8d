"""Silhouettes of meshes against a renderer that draws them alone, and against the same shape in parts."""

import dataclasses
import math

import numpy as np
import pytest
from mesh_scenes import BOARD, TABLE, board_mesh, box_quads, quads, with_meshes

from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.labels.amodal import amodal_extents, scene_solids
from langwm_data.scenes.assets import Assets
from langwm_data.scenes.meshes.triangles import Material
from langwm_data.scenes.spec import IDENTITY, OWN, MeshSpec, ObjectSpec, PartSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.render_embree import EmbreeRenderer

CAMERA = dataclasses.replace(
    Camera.on_robot(CameraConfig(height=96, width=120), (0.0, 0.0), 0.0), position=(0.0, 0.0, 0.5)
)


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    return Assets(tmp_path_factory.mktemp("assets"))


@pytest.fixture(scope="module")
def scene(small_scene, assets):
    return with_meshes(small_scene, assets)


def drawn(scene, assets, camera):
    """Pixels by instance id."""
    renderer = EmbreeRenderer(RenderConfig(texture_px=16), assets)
    renderer.load(scene)
    ids, counts = np.unique(renderer.render(camera).instance, return_counts=True)
    return {int(i): int(n) for i, n in zip(ids, counts, strict=True) if i}


def alone(scene, instance):
    objects = tuple(o for o in scene.objects if o.instance == instance)
    return dataclasses.replace(scene, surfaces=(), objects=objects)


def wide(camera, factor):
    """The same picture with more around it."""
    fov = 2 * math.atan(factor * math.tan(camera.vertical_fov_rad / 2))
    size = {"height": factor * camera.height, "width": factor * camera.width}
    return dataclasses.replace(camera, vertical_fov_rad=fov, **size)


def views(count):
    for seed in range(count):
        rng = np.random.default_rng(seed)
        xy = rng.uniform((0.3, 1.0), (2.2, 2.8)).tolist()
        yaw = math.atan2(1.4 - xy[1], 2.0 - xy[0]) + float(rng.uniform(-0.5, 0.5))
        yield dataclasses.replace(
            CAMERA, position=(*xy, float(rng.uniform(0.3, 1.5))), yaw_rad=yaw, pitch_rad=-0.2
        )


def test_fractions_are_those_of_a_renderer_that_draws_the_mesh_alone(scene, assets):
    solids, seen, cut = scene_solids(scene, assets), set(), 0
    for camera in views(12):
        visible = drawn(scene, assets, camera)
        found = amodal_extents(solids, camera, visible)
        for instance in {BOARD, TABLE} & set(visible):
            inside = drawn(alone(scene, instance), assets, camera)[instance]
            whole = drawn(alone(scene, instance), assets, wide(camera, 5))[instance]
            extent = found[instance]
            assert extent.occluded_fraction == pytest.approx(1 - visible[instance] / inside, abs=0.02)
            assert extent.truncated_fraction == pytest.approx(1 - inside / whole, abs=0.02)
            seen.add(instance)
            cut += extent.truncated_fraction > 0.1
    assert seen == {BOARD, TABLE}
    assert cut >= 2


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi])
def test_a_mesh_covers_what_the_same_boxes_cover(small_scene, assets, yaw):
    corners = [((-0.3, -0.2, 0.0), (0.3, 0.2, 0.2)), ((-0.1, -0.1, 0.1), (0.1, 0.1, 0.9))]
    mesh = quads([[q for low, high in corners for q in box_quads(low, high)]], [Material(color=(1, 1, 1))])
    parts = tuple(
        PartSpec(shape="box", size=tuple(np.subtract(b, a)), position=tuple(np.add(a, b) / 2), slot=0)
        for a, b in corners
    )
    plain = ObjectSpec(
        instance=7,
        category="vase",
        model="x",
        room="",
        position=(2.0, 0.1, 0.1),
        orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
        size=(0.6, 0.4, 0.9),
        parts=parts,
    )
    meshed = dataclasses.replace(plain, mesh=MeshSpec(name=assets.add_mesh(mesh), slots=(OWN,)))
    extents = [
        amodal_extents(
            scene_solids(dataclasses.replace(small_scene, surfaces=(), objects=(o,)), assets), CAMERA, {7: 50}
        )
        for o in (plain, meshed)
    ]
    assert dataclasses.astuple(extents[0][7]) == pytest.approx(dataclasses.astuple(extents[1][7]))


def test_a_sheet_covers_as_much_from_behind(small_scene, assets):
    board = ObjectSpec(
        instance=7,
        category="picture",
        model="x",
        room="",
        position=(2.0, 0.0, 0.1),
        orientation=IDENTITY,
        size=(1.2, 0.1, 0.8),
        parts=(),
        mesh=MeshSpec(name=assets.add_mesh(board_mesh()), slots=(OWN,)),
    )
    quarter = math.sqrt(0.5)
    shares = []
    for z in (quarter, -quarter):
        turned = dataclasses.replace(board, orientation=(0.0, 0.0, z, quarter))
        solids = scene_solids(dataclasses.replace(small_scene, surfaces=(), objects=(turned,)), assets)
        shares.append(amodal_extents(solids, CAMERA, {7: 100})[7].visible_fraction)
    assert shares[0] == pytest.approx(shares[1], rel=0.01)
    assert 100 / shares[0] == pytest.approx(1.2 * 0.8 * (CAMERA.focal_px / 2.0) ** 2, rel=0.03)


def test_what_lies_behind_the_camera_covers_nothing_of_it(scene, assets):
    camera = dataclasses.replace(CAMERA, position=(2.9, 1.9, 0.3), yaw_rad=math.pi / 2)
    found = amodal_extents(scene_solids(scene, assets), camera, {BOARD: 5, TABLE: 5})
    assert found[BOARD].visible_fraction == 1.0  # five pixels that are claimed are there
    assert 0 < found[TABLE].visible_fraction < 1
