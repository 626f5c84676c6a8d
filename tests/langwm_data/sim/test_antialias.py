"""Edges of small pictures, by hand."""

import numpy as np

from langwm_data.sim.antialias import QUARTERS, OpenQuarters, find_open_quarters, smooth_edges

LEFT_RIGHT = np.int32([[1, 1, 2, 2], [1, 1, 2, 2], [1, 1, 2, 2]])


def picture(faces):
    return (np.stack([faces * 40, faces * 80, faces * 0], axis=-1)).astype(np.uint8)


def test_quarters_that_border_on_another_face_are_open():
    quarters = find_open_quarters(LEFT_RIGHT)
    row, column = np.divmod(quarters.pixel, 4)
    sides = QUARTERS[quarters.number, 1]
    assert set(zip(column.tolist(), sides.tolist(), strict=True)) == {(1, 1), (2, -1)}
    assert sorted(set(row.tolist())) == [0, 1, 2]
    assert len(quarters.pixel) == 12


def test_a_face_that_touches_only_diagonally_opens_one_quarter():
    faces = np.int32([[1, 1, 1], [1, 1, 1], [1, 1, 5]])
    quarters = find_open_quarters(faces)
    center = QUARTERS[quarters.number[quarters.pixel == 4]].tolist()
    assert center == [[1, 1]]


def test_a_picture_of_one_face_has_no_open_quarters():
    assert len(find_open_quarters(np.ones((5, 6), np.int32)).pixel) == 0


def test_a_pixel_becomes_the_mean_of_its_quarters():
    rgb, quarters = picture(LEFT_RIGHT), find_open_quarters(LEFT_RIGHT)
    seen = LEFT_RIGHT.ravel()[quarters.pixel]
    # In the pixel of row 1, column 1 both right quarters show face 2; elsewhere all is as it seems.
    seen[quarters.pixel == 5] = 2
    smooth_edges(rgb, LEFT_RIGHT, quarters, seen)
    expected = picture(LEFT_RIGHT)
    expected[1, 1] = (60, 120, 0)
    assert np.array_equal(rgb, expected)


def test_a_face_that_no_neighbour_shows_counts_as_the_pixel_s_own():
    rgb, quarters = picture(LEFT_RIGHT), find_open_quarters(LEFT_RIGHT)
    smooth_edges(rgb, LEFT_RIGHT, quarters, np.full(len(quarters.pixel), 9, np.int32))
    assert np.array_equal(rgb, picture(LEFT_RIGHT))


def test_dark_quarters_darken_and_bright_ones_brighten():
    faces = np.int32([[1, 6]])
    for pixel, expected in [(0, (90, 180, 0)), (1, (190, 124, 0))]:
        rgb = picture(faces)
        rgb[0, 1] = (240, 124, 0)
        rgb[0, 0] = (40, 236 if pixel == 0 else 124, 0)
        quarters = OpenQuarters(number=np.array([1]), pixel=np.array([pixel]))
        before = rgb.astype(int)
        smooth_edges(rgb, faces, quarters, np.int32([faces[0, 1 - pixel]]))
        mixed = (3 * before[0, pixel] + before[0, 1 - pixel] + 2) // 4
        assert rgb[0, pixel].tolist() == mixed.tolist()
        assert expected[0] == mixed[0]
