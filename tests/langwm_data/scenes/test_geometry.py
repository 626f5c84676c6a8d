import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from langwm_data.scenes.geometry import (
    Boxes,
    axis_quat,
    part_polygon,
    point_polygon_distance,
    quat_matrix,
    quat_product,
    rects_overlap,
    yaw_quat,
)
from langwm_data.scenes.spec import IDENTITY, PartSpec

ANGLE = st.floats(-math.pi, math.pi)


def box(size, position=(0.0, 0.0, 0.0), orientation=IDENTITY, shape="box"):
    part = PartSpec(shape=shape, size=size, position=(0.0, 0.0, 0.0), slot=0)
    return position, orientation, part


def corners(pose):
    position, orientation, part = pose
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T / 2
    return Rotation.from_quat(orientation).apply(signs * part.size) + position


def share_a_point(a, b) -> bool:
    """Two convex bodies meet when some mix of the corners of one equals a mix of the other's."""
    points = [corners(a), corners(b)]
    n = [len(p) for p in points]
    equal = np.concatenate([points[0], -points[1]]).T
    sums = np.array([[1.0] * n[0] + [0.0] * n[1], [0.0] * n[0] + [1.0] * n[1]])
    result = linprog(np.zeros(sum(n)), A_eq=np.concatenate([equal, sums]), b_eq=[0, 0, 0, 1, 1])
    return result.status == 0


@given(ANGLE, ANGLE)
def test_quaternions_agree_with_scipy(a, b):
    turn, tilt = yaw_quat(a), axis_quat((1.0, 0.0, 0.0), b)
    expected = Rotation.from_euler("z", a) * Rotation.from_euler("x", b)
    assert np.allclose(quat_matrix(quat_product(turn, tilt)), expected.as_matrix(), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_overlap_of_oriented_boxes_agrees_with_linear_programming(seed):
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(2):
        quat = tuple(Rotation.random(random_state=rng).as_quat())
        poses.append(box(tuple(rng.uniform(0.2, 1.5, 3)), tuple(rng.uniform(-0.7, 0.7, 3)), quat))
    a, b = (Boxes.of_parts([p]) for p in poses)
    shrunk, grown = a.overlap(b, tolerance_m=1e-6)[0, 0], a.overlap(b, tolerance_m=-1e-6)[0, 0]
    assert shrunk <= share_a_point(*poses) <= grown


def test_touching_boxes_do_not_overlap_and_pressed_ones_do():
    a = Boxes.of_parts([box((1, 1, 1))])
    beside = Boxes.of_parts([box((1, 1, 1), (1, 0, 0)), box((1, 1, 1), (0.99, 0, 0))])
    assert a.overlap(beside, tolerance_m=0.002).tolist() == [[False, True]]


def test_polygon_of_an_upright_box_is_its_turned_rectangle():
    polygon = part_polygon(*box((2, 1, 3), (5, 5, 1), yaw_quat(math.pi / 2)))
    assert np.allclose(polygon.min(axis=0), [4.5, 4])
    assert np.allclose(polygon.max(axis=0), [5.5, 6])


def test_polygon_of_a_tilted_box_covers_the_shadow_of_its_corners():
    pose = box((0.3, 1.0, 2.0), (1, 2, 3), quat_product(yaw_quat(0.4), axis_quat((1, 0, 0), 0.7)))
    assert ConvexHull(part_polygon(*pose)).volume == pytest.approx(ConvexHull(corners(pose)[:, :2]).volume)


def test_polygon_of_a_cylinder_lies_around_the_circle_and_close_to_it():
    polygon = part_polygon(*box((1, 1, 2), shape="cylinder"))
    edge_middles = (polygon + np.roll(polygon, -1, axis=0)) / 2
    assert np.allclose(np.linalg.norm(edge_middles, axis=1), 0.5)
    assert np.linalg.norm(polygon, axis=1).max() < 0.52


def test_distance_to_a_polygon_inside_beside_and_off_a_corner():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    points = np.array([[0.5, 0.5], [0.5, -2], [4, 5]])
    assert np.allclose(point_polygon_distance(points, square), [0, 2, 5])


def test_rectangles_closer_than_the_gap_count_as_overlapping():
    a, b = (0, 0, 1, 1), (1.01, 0, 2, 1)
    assert not rects_overlap(a, b)
    assert rects_overlap(a, b, 0.02)
    assert not rects_overlap(a, (1, 0, 2, 1))
