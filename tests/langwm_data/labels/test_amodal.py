"""Silhouettes against a renderer that draws one object alone, and against sums done by hand."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.config import RenderConfig
from langwm_data.labels.amodal import amodal_extents, scene_solids
from langwm_data.scenes.geometry import axis_quat
from langwm_data.scenes.spec import ObjectSpec, PartSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.render_tiny import TinyRenderer

LEVEL = (0.0, 0.0, 0.0, 1.0)
CAMERA = Camera(
    height=96, width=120, vertical_fov_rad=math.radians(50), position=(0.0, 0.0, 0.0), yaw_rad=0.0
)
"""Looks along +x; y is to the left."""
WIDER = 5


def box(size, position, **others):
    return PartSpec(shape="box", size=size, position=position, slot=0, **others)


def make_object(instance, *parts, position=(0.0, 0.0, 0.0), orientation=LEVEL):
    return ObjectSpec(
        instance=instance,
        category="chair",
        model="chair_01",
        room="study",
        position=position,
        orientation=orientation,
        size=(1.0, 1.0, 1.0),
        parts=parts,
    )


@pytest.fixture
def solids_of(small_scene):
    """Solids of a scene of these objects alone."""
    return lambda *objects: scene_solids(dataclasses.replace(small_scene, surfaces=(), objects=objects))


@pytest.fixture(scope="module")
def renderer():
    renderer = TinyRenderer(RenderConfig())
    yield renderer
    renderer.close()


def extent(solids, visible, camera=CAMERA):
    return amodal_extents(solids, camera, {7: visible})[7]


def size_of_silhouette(solids, camera=CAMERA):
    """Its pixels, inside and outside."""
    found = extent(solids, 1, camera)
    total = 1 / found.visible_fraction
    return total * (1 - found.truncated_fraction), total * found.truncated_fraction


def face(width, height, distance, left=0.0, up=0.0):
    """A deep box whose front hides its sides, at a distance before the camera."""
    return make_object(7, box((0.02, width, height), (distance + 0.01, left, up)))


def test_a_face_covers_what_the_pinhole_says(solids_of):
    fine = dataclasses.replace(CAMERA, height=10 * CAMERA.height, width=10 * CAMERA.width)
    inside, outside = size_of_silhouette(solids_of(face(0.8, 0.5, 2.0)), fine)
    assert inside == pytest.approx(0.8 * 0.5 * (fine.focal_px / 2.0) ** 2, rel=0.005)
    assert outside == 0


def test_an_object_that_shows_all_of_itself_is_wholly_visible(solids_of):
    solids = solids_of(face(0.8, 0.5, 2.0))
    inside, _ = size_of_silhouette(solids)
    found = extent(solids, round(inside))
    assert (found.visible_fraction, found.truncated_fraction, found.occluded_fraction) == (1.0, 0.0, 0.0)


def test_half_hidden_is_a_half(solids_of):
    solids = solids_of(face(0.8, 0.5, 2.0))
    inside, _ = size_of_silhouette(solids)
    found = extent(solids, round(inside / 2))
    assert found.visible_fraction == found.occluded_fraction == pytest.approx(0.5, abs=0.001)
    assert found.truncated_fraction == 0.0


@pytest.mark.parametrize("share", [0.25, 0.5, 0.9])
def test_what_the_pictures_edge_cuts_off_is_truncated(solids_of, share):
    edge_m = 2.0 * CAMERA.width / 2 / CAMERA.focal_px
    solids = solids_of(face(0.8, 0.5, 2.0, left=edge_m + (share - 0.5) * 0.8))
    inside, _ = size_of_silhouette(solids)
    found = extent(solids, round(inside))
    assert found.truncated_fraction == pytest.approx(share, abs=0.02)
    assert found.visible_fraction == pytest.approx(1 - share, abs=0.02)
    assert found.occluded_fraction == 0.0


def test_truncation_is_the_same_at_all_four_edges(solids_of):
    square = dataclasses.replace(CAMERA, width=CAMERA.height)
    edge_m = 2.0 * square.height / 2 / square.focal_px
    cut = [
        extent(solids_of(face(0.6, 0.6, 2.0, left=y * edge_m, up=z * edge_m)), 1, square).truncated_fraction
        for y, z in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    assert cut == pytest.approx([0.5] * 4, abs=0.02)


def test_parts_that_overlap_count_once(solids_of):
    whole = solids_of(face(0.8, 0.5, 2.0))
    halves = solids_of(
        make_object(7, box((0.02, 0.5, 0.5), (2.01, 0.15, 0.0)), box((0.02, 0.5, 0.5), (2.01, -0.15, 0.0)))
    )
    assert size_of_silhouette(halves) == size_of_silhouette(whole)


def test_objects_in_one_view_are_measured_apart(solids_of):
    first, second = face(0.8, 0.5, 2.0, left=0.2), face(1.5, 0.3, 3.0)
    together = solids_of(first, dataclasses.replace(second, instance=8))
    found = amodal_extents(together, CAMERA, {8: 11, 7: 5})
    assert list(found) == [8, 7]
    assert found[7] == extent(solids_of(first), 5)
    assert found[8] == extent(solids_of(second), 11)


def test_what_reaches_behind_the_camera_ends_at_the_near_plane(solids_of):
    """A board on the floor from 3 m behind the camera to 4 m before it, seen from 0.3 m above."""
    height, half_width, far, thick = 0.3, 0.4, 4.0, 0.01
    board = make_object(7, box((7.0, 2 * half_width, thick), (0.5, 0.0, -height - thick / 2)))
    inside, outside = size_of_silhouette(solids_of(board))
    near, focal = CAMERA.near_m, CAMERA.focal_px
    top, bottom = focal * height / far, focal * height / near
    trapezoid = half_width / height * (bottom**2 - top**2)
    front = focal * thick / near * 2 * half_width * focal / near
    rows = np.arange(0.5, CAMERA.height / 2)
    shown = np.clip(2 * half_width / height * rows[rows > top], 0, CAMERA.width).sum()
    assert inside == pytest.approx(shown, rel=0.01)
    assert inside / (inside + outside) == pytest.approx(shown / (trapezoid + front), abs=0.001)


def test_a_view_of_nothing_has_no_extents(solids_of):
    assert amodal_extents(solids_of(face(1.0, 1.0, 2.0)), CAMERA, {}) == {}


VIEWS = [
    Camera(height=60, width=80, vertical_fov_rad=0.9, position=(3.5, 0.4, 0.9), yaw_rad=2.4, pitch_rad=-0.3),
    Camera(height=60, width=80, vertical_fov_rad=0.9, position=(0.5, 1.5, 0.3), yaw_rad=0.9, pitch_rad=0.1),
    Camera(height=60, width=80, vertical_fov_rad=0.7, position=(2.0, 1.4, 0.6), yaw_rad=2.2),
    Camera(height=60, width=80, vertical_fov_rad=0.9, position=(4.6, 0.6, 1.4), yaw_rad=0.6, pitch_rad=-0.2),
]


def alone(renderer, scene, obj, camera):
    """Pixels of an object that stands alone, inside the picture and in one that is much larger."""
    renderer.load(dataclasses.replace(scene, surfaces=(), objects=(obj,)))
    wide = dataclasses.replace(
        camera,
        height=WIDER * camera.height,
        width=WIDER * camera.width,
        vertical_fov_rad=2 * math.atan(WIDER * math.tan(camera.vertical_fov_rad / 2)),
    )
    mask = renderer.render(wide).instance == obj.instance
    rows, columns = (slice(n * (WIDER // 2), n * (WIDER // 2 + 1)) for n in (camera.height, camera.width))
    is_whole = not any(edge.any() for edge in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
    return int(mask[rows, columns].sum()), int(mask.sum()), is_whole


def ball_and_cone():
    """What the small scene lacks: an ellipsoid, a pointed frustum, a part turned against its owner."""
    ball = PartSpec(shape="ellipsoid", size=(0.3, 0.5, 0.4), position=(0.0, 0.0, 0.2), slot=3)
    cone = PartSpec(shape="frustum", size=(0.4, 0.4, 0.3), position=(0.3, 0.0, 0.6), slot=3, taper=0.0)
    turned = box((0.5, 0.1, 0.2), (0.0, 0.3, 0.5), orientation=axis_quat((0.6, 0.0, 0.8), 0.7))
    return make_object(
        40, ball, cone, turned, position=(2.4, 2.2, 0.1), orientation=axis_quat((0.0, 0.6, 0.8), 0.5)
    )


@pytest.mark.parametrize("camera", VIEWS)
def test_fractions_are_those_of_a_renderer_that_draws_the_object_alone(renderer, small_scene, camera):
    scene = dataclasses.replace(small_scene, objects=(*small_scene.objects, ball_and_cone()))
    renderer.load(scene)
    mask = renderer.render(camera).instance
    visible = {n: int((mask == n).sum()) for n in np.unique(mask).tolist() if n}
    found = amodal_extents(scene_solids(scene), camera, visible)
    num = 0
    for obj in scene.objects:
        if visible.get(obj.instance, 0) < 20:
            continue
        inside, whole, is_whole = alone(renderer, scene, obj, camera)
        assert found[obj.instance].occluded_fraction == pytest.approx(
            1 - visible[obj.instance] / inside, abs=0.01
        )
        if is_whole:
            assert found[obj.instance].truncated_fraction == pytest.approx(1 - inside / whole, abs=0.01)
            assert found[obj.instance].visible_fraction == pytest.approx(
                visible[obj.instance] / whole, abs=0.01
            )
            num += 1
    assert num >= 1


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(0.2, 3.8),
    y=st.floats(0.2, 2.8),
    yaw=st.floats(-3.2, 3.2),
    pitch=st.floats(-1.5, 1.5),
    visible=st.integers(1, 9000),
)
def test_fractions_are_fractions_and_belong_together(small_scene, x, y, yaw, pitch, visible):
    camera = dataclasses.replace(CAMERA, position=(x, y, 0.5), yaw_rad=yaw, pitch_rad=pitch)
    numbers = sorted(small_scene.instances())
    found = amodal_extents(scene_solids(small_scene), camera, dict.fromkeys(numbers, visible))
    assert sorted(found) == numbers
    for one in found.values():
        values = dataclasses.astuple(one)
        assert all(type(value) is float and 0.0 <= value <= 1.0 for value in values)
        assert one.visible_fraction > 0
        assert one.visible_fraction == pytest.approx(
            (1 - one.truncated_fraction) * (1 - one.occluded_fraction)
        )


def test_every_part_is_closed_by_its_edges(small_scene):
    """Euler's formula, and planes that have the whole part behind them."""
    scene = dataclasses.replace(small_scene, objects=(*small_scene.objects, ball_and_cone()))
    for solid in scene_solids(scene).parts.values():
        for part in range(solid.num_parts):
            is_mine = solid.parts == part
            corners = np.unique(solid.ends[is_mine].reshape(-1, 3).round(6), axis=0)
            num_faces = len(np.unique(solid.faces[is_mine]))
            assert len(corners) - is_mine.sum() + num_faces == 2
            planes = solid.planes[is_mine].reshape(-1, 4)
            assert (corners @ planes[:, :3].T + planes[:, 3]).max() < 1e-5
