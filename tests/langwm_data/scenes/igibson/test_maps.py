"""Maps lie in the world as they do in iGibson: columns along x, rows along y, neither turned round."""

import cv2
import numpy as np
import pytest
from PIL import Image

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.maps import read_floor_map, read_rooms

LAYOUT = "scenes/Rs_int/layout"
KINDS = ("bathroom", "bedroom", "kitchen")


def blank(value=0, side=400):
    return np.full((side, side), value, np.uint8)


@pytest.fixture
def data(dataset):
    return DataFolder(dataset.root)


def write(dataset, **images):
    for name, image in images.items():
        dataset.png(f"{LAYOUT}/{name}.png", image)


def test_columns_run_along_x_and_rows_along_y(dataset, data):
    free = blank()
    free[250:350, 60:90] = 255  # rows 250 to 350: y 0.5 to 1.5; columns 60 to 90: x -1.4 to -1.1
    write(dataset, floor_trav_no_obj_0=free, floor_no_obj_0=blank(255))
    floor = read_floor_map(data, LAYOUT)
    inside = np.array([(-1.25, 1.0), (-1.15, 1.45), (-1.25, 0.65)])
    outside = np.array([(1.0, -1.25), (1.25, 1.0), (-1.25, -1.0), (-1.45, 1.0), (-1.05, 1.0), (9.0, 9.0)])
    assert floor.free_at(inside).all()
    assert not floor.free_at(outside).any()


def test_erosion_takes_the_first_cell_along_both_axes(dataset, data):
    free = blank()
    free[200:300, 200:300] = 255
    write(dataset, floor_trav_no_obj_0=free, floor_no_obj_0=blank(255))
    floor = read_floor_map(data, LAYOUT)
    x = np.arange(0.05, 1.0, 0.1)
    grid = floor.free_at(np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1))
    expected = np.ones((10, 10), bool)
    expected[0, :] = expected[:, 0] = False  # OpenCV's 2 x 2 kernel looks at the cell and those before it
    np.testing.assert_array_equal(grid, expected)


def test_obstacles_are_not_free_and_of_several_parts_the_largest_is_kept(dataset, data):
    free = blank(255)
    obstacles = blank(255)
    obstacles[:, 250:260] = 0
    write(dataset, floor_trav_no_obj_0=free, floor_no_obj_0=obstacles)
    floor = read_floor_map(data, LAYOUT)
    assert floor.free_at(np.array([(-1.0, 0.0), (0.45, 0.0)])).all()
    assert not floor.free_at(np.array([(0.55, 0.0), (1.0, 0.0)])).any()


def test_cells_that_meet_at_a_corner_hang_together(dataset, data):
    free = blank()
    free[100:200, 100:200] = 255
    free[190:300, 190:300] = 255  # after erosion the two meet at a corner only
    write(dataset, floor_trav_no_obj_0=free, floor_no_obj_0=blank(255))
    assert read_floor_map(data, LAYOUT).free_at(np.array([(-0.5, -0.5), (0.5, 0.5)])).all()


def test_rooms_are_named_as_scenes_name_them(dataset, data):
    instances, kinds = blank(), blank()
    for number, kind, (row, column) in ((9, 2, (0, 0)), (4, 2, (300, 100)), (5, 3, (100, 300))):
        instances[row : row + 80, column : column + 60] = number
        kinds[row : row + 80, column : column + 60] = kind
    write(dataset, floor_insseg_0=instances, floor_semseg_0=kinds)
    found = read_rooms(data, LAYOUT, KINDS)
    # The bedroom of the smaller number is the first.
    assert {r.name: r.rect for r in found.rooms} == {
        "bedroom_0": (-1.0, 1.0, -0.4, 1.8),
        "kitchen_0": (1.0, -1.0, 1.6, -0.2),
        "bedroom_1": (-2.0, -2.0, -1.4, -1.2),
    }
    points = np.array([(-0.7, 1.4), (1.3, -0.5), (-1.9, -1.9), (1.9, -0.9), (50.0, -50.0)])
    names = [found.rooms[i].name for i in found.rooms_at(points)]
    assert names == ["bedroom_0", "kitchen_0", "bedroom_1", "kitchen_0", "kitchen_0"]


def test_a_map_in_the_colours_of_a_palette_means_their_numbers(dataset, data):
    kinds, instances = blank(), blank()
    kinds[100:300, 100:300], instances[100:300, 100:300] = 2, 9
    write(dataset, floor_insseg_0=instances)
    picture = Image.fromarray(kinds, mode="P")
    picture.putpalette([7, 7, 7, 200, 0, 0, 7, 7, 7])  # numbers 0 and 2 look the same
    picture.save(dataset.root / LAYOUT / "floor_semseg_0.png")
    assert [room.name for room in read_rooms(data, LAYOUT, KINDS).rooms] == ["bedroom_0"]


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ({"floor_trav_no_obj_0": blank()}, "floor_trav_no_obj_0.png: nothing is free"),
        ({"floor_no_obj_0": blank(255, 300)}, "are of different sizes"),
        ({"floor_no_obj_0": np.zeros((400, 300), np.uint8)}, "a map of 300 x 400 pixels; allowed: square"),
        ({"floor_no_obj_0": np.zeros((400, 400, 3), np.uint8)}, "allowed: one channel"),
    ],
)
def test_floor_maps_that_cannot_be_meant_are_refused(dataset, data, images, message):
    write(dataset, **{"floor_trav_no_obj_0": blank(255), "floor_no_obj_0": blank(255)} | images)
    with pytest.raises(ValueError, match=message):
        read_floor_map(data, LAYOUT)


def test_huge_maps_are_refused_before_they_are_decoded(dataset, data, monkeypatch):
    write(dataset, floor_trav_no_obj_0=np.zeros((11_000, 11_000), np.uint8))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(ValueError, match="a map of 11000 x 11000 pixels; allowed: square, at most 10000"):
        read_floor_map(data, LAYOUT)


def test_damaged_maps_are_refused(dataset, data):
    place = dataset.root / LAYOUT / "floor_no_obj_0.png"
    place.write_bytes(place.read_bytes()[:60])
    with pytest.raises(ValueError, match=r"floor_no_obj_0\.png: a damaged map"):
        read_floor_map(data, LAYOUT)


@pytest.mark.parametrize(
    ("instances", "kinds", "message"),
    [
        (blank(1), blank(4), "shows room kind 4; room_categories.txt lists 3"),
        (blank(1), blank(0), "shows room kind 0"),
        (blank(0), blank(0), "shows no room"),
        (blank(1), blank(1, 300), "are of different sizes"),
    ],
)
def test_room_maps_that_cannot_be_meant_are_refused(dataset, data, instances, kinds, message):
    write(dataset, floor_insseg_0=instances, floor_semseg_0=kinds)
    with pytest.raises(ValueError, match=message):
        read_rooms(data, LAYOUT, KINDS)
