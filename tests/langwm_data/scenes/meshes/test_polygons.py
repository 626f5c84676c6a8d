import cv2
import numpy as np
import pytest

from langwm_data.scenes.meshes import polygons
from langwm_data.scenes.meshes.polygons import triangulate

STAR = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(10) * np.pi / 5, [100, 40] * 5, strict=True)]
COMB = [(0, 0), (90, 0), (90, 60), (80, 60), (80, 10), (50, 10), (50, 60), (40, 60), (40, 10), (0, 10)]
SQUARE_WITH_HOLE = [
    (0, 0), (90, 0), (90, 90), (0, 90), (0, 0),
    (30, 30), (30, 60), (60, 60), (60, 30), (30, 30),
]  # fmt: skip
ARROW = [(0, 0), (50, 20), (100, 0), (50, 80)]


def painted(shapes):
    picture = np.zeros((256, 256), np.uint8)
    for shape in shapes:
        cv2.fillPoly(picture, [np.round((np.asarray(shape)[:, :2] + 110) * 256).astype(np.int32)], 1, shift=8)
    return picture


@pytest.mark.parametrize(
    "outline", [STAR, COMB, ARROW, SQUARE_WITH_HOLE], ids=["star", "comb", "arrow", "hole"]
)
@pytest.mark.parametrize("is_reversed", [False, True])
def test_triangles_paint_what_opencv_paints_for_the_polygon(outline, is_reversed):
    points = np.column_stack([outline, np.zeros(len(outline))])[:: -1 if is_reversed else 1]
    triangles, owner = triangulate(points, np.array([len(points)]))
    assert len(triangles) == len(points) - 2
    assert not owner.any()
    # OpenCV paints outlines too, which for triangles lie inside: one pixel along them may differ.
    differs = painted([points]) != painted(points[triangles])
    assert not cv2.erode(differs.astype(np.uint8), np.ones((3, 3), np.uint8)).any()


@pytest.mark.parametrize("turn", [0, 1, 2])
def test_triangles_turn_the_way_the_polygon_does_and_cover_its_area(turn):
    flat = np.column_stack([STAR, np.full(10, 7.0)])
    points = np.roll(flat, turn, axis=1)
    triangles, _ = triangulate(points, np.array([10]))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    axis = (2 + turn) % 3
    assert (normals[:, axis] >= 0).all()
    assert normals[:, axis].sum() / 2 == pytest.approx(cv2.contourArea(np.float32(STAR)), rel=1e-6)


def test_polygons_of_all_sizes_keep_their_order():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    points = np.concatenate([square, square[:3], square[:2], square])
    triangles, owner = triangulate(points, np.array([4, 3, 2, 4]))
    assert owner.tolist() == [0, 0, 1, 3, 3]
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [9, 10, 11], [9, 11, 12]]


def test_a_polygon_that_crosses_itself_still_ends():
    bow = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0], [0.5, 3, 0]])
    assert triangulate(bow, np.array([5]))[0].shape == (3, 3)
    assert triangulate(np.zeros((6, 3)), np.array([6]))[0].shape == (4, 3)


def test_limits(monkeypatch):
    star = np.column_stack([STAR, np.zeros(10)])
    with pytest.raises(ValueError, match="has a polygon of 2000 corners; at most 1024 are read"):
        triangulate(np.zeros((2000, 3)), np.array([2000]))
    monkeypatch.setattr(polygons, "MAX_CLIPPING_STEPS", 99)
    with pytest.raises(ValueError, match="has polygons that are too dented; at most 99 steps are taken"):
        triangulate(star, np.array([10]))
