import numpy as np
import pytest

from langwm_data.scenes.meshes.distances import to_segments, to_triangles


def test_distances_to_triangles_are_those_of_trimesh():
    trimesh = pytest.importorskip("trimesh")
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(500, 3, 3)), rng.normal(size=(500, 3)) * 2
    closest = trimesh.triangles.closest_point(corners, points)
    expected = np.linalg.norm(points - closest, axis=1)
    assert np.allclose(to_triangles(points, *np.moveaxis(corners, 1, 0)), expected)


def test_distances_to_segments_and_to_what_has_shrunk_to_less():
    a, b = np.array([[0.0, 0, 0]]), np.array([[2.0, 0, 0]])
    for point, expected in (([1, 3, 0], 3), ([-3, 4, 0], 5), ([5, 0, 4], 5), ([2, 0, 0], 0)):
        assert to_segments(np.array([point]), a, b) == pytest.approx(expected)
        assert to_triangles(np.array([point]), a, b, (a + b) / 2) == pytest.approx(expected)
    assert to_segments(np.array([[3.0, 4, 0]]), a, a) == pytest.approx(5)
    assert to_triangles(np.array([[3.0, 4, 0]]), a, a, a) == pytest.approx(5)
