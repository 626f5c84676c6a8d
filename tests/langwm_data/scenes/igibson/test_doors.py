"""Doors open as wide as they go; how wide is worked out here from the geometry of the test's door."""

import numpy as np
import pytest

from langwm_data.scenes.igibson.doors import open_positions, outline
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.models import read_model
from langwm_data.scenes.igibson.objects import make_instance
from langwm_data.scenes.igibson.urdf import Origin, Placed

STEP = np.pi / 36


@pytest.fixture
def data(dataset):
    return DataFolder(dataset.root)


def door(data, yaw=0.0, box=(1.0, 0.2, 2.0)):
    """In the origin; its hinge is at x -0.44, its leaf 0.88 m long and, closed, points along x."""
    placed = Placed(
        name="door_0",
        category="door",
        model="door_a",
        rooms=(),
        bounding_box=box,
        scale=None,
        random_group="",
        origin=Origin(xyz=(0, 0, 1.0), rpy=(0, 0, yaw)),
    )
    return make_instance(data, placed, read_model(data, "door", "door_a"))


def block(x0, y0, x1, y1, z0=0.0, z1=2.4):
    corners = np.array(list(np.ndindex(2, 2, 2)), float)
    return outline(corners * (x1 - x0, y1 - y0, z1 - z0) + (x0, y0, z0))


def test_a_door_with_nothing_around_opens_to_its_limit(data):
    assert open_positions(data, door(data), []) == {"hinge": 3.0}


def test_a_door_stops_at_the_first_position_that_touches_nothing(data):
    # A wall beyond x -1 is reached by the leaf's end when 0.44 + 0.88 |cos a| > 1.
    wall = block(-1.2, -3, -1.0, 3)
    opened = open_positions(data, door(data), [wall])["hinge"]
    reach = 0.44 - 0.88 * np.cos(opened)
    wider = 0.44 - 0.88 * np.cos(opened + STEP)
    assert reach < 1.0 + 0.04 < wider + 0.08
    assert wider > 1.0
    assert (3.0 - opened) / STEP == pytest.approx(round((3.0 - opened) / STEP))


def test_the_yaw_of_a_door_turns_its_leaf(data):
    # With a quarter turn the hinge is at y -0.44 and the leaf opens towards -x.
    assert open_positions(data, door(data, np.pi / 2), [block(0.03, -3, 0.4, 3)]) == {"hinge": 3.0}
    assert open_positions(data, door(data, np.pi / 2), [block(-0.4, -3, -0.03, 3)])["hinge"] < 1.0


def test_what_is_above_or_below_the_leaf_does_not_stop_it(data):
    assert open_positions(data, door(data), [block(-3, -3, 3, 3, 1.99, 2.4)]) == {"hinge": 3.0}
    assert open_positions(data, door(data), [block(-3, -3, 3, 3, -0.2, 0.02)]) == {"hinge": 3.0}


def test_a_door_that_can_only_be_closed_stays_closed(data):
    assert open_positions(data, door(data), [block(-3, -3, 3, 3)]) == {}


def test_a_joint_without_limits_stays_closed(dataset, data):
    place = dataset.root / "objects/door/door_a/door_a.urdf"
    place.write_text(place.read_text().replace('upper="3.0"', 'upper="0"'))
    assert open_positions(data, door(data), []) == {}


def test_a_sliding_door_slides_as_far_as_its_scale_makes_it(dataset, data):
    place = dataset.root / "objects/door/door_a/door_a.urdf"
    text = (
        place.read_text()
        .replace('type="revolute"', 'type="prismatic"')
        .replace('axis xyz="0 0 1"', 'axis xyz="1 0 0"')
    )
    place.write_text(text.replace('upper="3.0"', 'upper="0.8"'))
    assert open_positions(data, door(data, box=(2.0, 0.2, 2.0)), []) == {"hinge": pytest.approx(1.6)}
    # From x -0.88 the leaf of 1.76 m ends at 0.88; the wall leaves it 0.57 m more: 11 steps of 5 cm.
    opened = open_positions(data, door(data, box=(2.0, 0.2, 2.0)), [block(1.45, -3, 1.6, 3)])["hinge"]
    assert opened == pytest.approx(0.55)
