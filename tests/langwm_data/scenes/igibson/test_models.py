"""Links stand where URDF says, scaled along each axis; floating joints divide bodies."""

import json

import numpy as np
import pytest

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.models import bodies, link_frames, read_model, shape_pose
from langwm_data.scenes.igibson.urdf import parse_robot

CABINET = "objects/bottom_cabinet/cabinet_a"


@pytest.fixture
def data(dataset):
    return DataFolder(dataset.root)


def chain(*joints):
    links = "".join(f'<link name="{name}"/>' for name in ("base_link", "a", "b", "c"))
    text = "".join(
        f'<joint name="j{i}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/></joint>'
        for i, (kind, parent, child, xyz, rpy, axis) in enumerate(joints)
    )
    return parse_robot(f"<robot>{links}{text}</robot>".encode(), "x.urdf")


CHAIN = (
    ("prismatic", "b", "c", "0 0 1", "0 0 0", "0 1 0"),
    ("revolute", "base_link", "a", "1 0 0", "0 0 0", "0 0 1"),
    ("floating", "a", "b", "0 2 0", f"0 0 {np.pi / 2}", "1 0 0"),
)


def test_frames_follow_the_chain_of_joints_whatever_their_order():
    frames = link_frames(chain(*CHAIN), (1.0, 1.0, 1.0), {}, "x.urdf")
    np.testing.assert_allclose(frames["a"].offset, (1, 0, 0))
    np.testing.assert_allclose(frames["b"].offset, (1, 2, 0))
    np.testing.assert_allclose(frames["c"].offset, (1, 2, 1))


def test_joints_turn_and_slide_along_scaled_axes():
    positions = {"j1": np.pi / 2, "j0": 0.5}
    frames = link_frames(chain(*CHAIN), (2.0, 1.0, 1.0), positions, "x.urdf")
    np.testing.assert_allclose(frames["a"].offset, (2, 0, 0))
    # a is turned by a quarter: its y points along -x.
    np.testing.assert_allclose(frames["b"].offset, (0, 0, 0), atol=1e-12)
    # b is turned by half a turn in all: sliding along its y goes along -y.
    np.testing.assert_allclose(frames["c"].offset, (0, -0.5, 1), atol=1e-12)


def test_floating_joints_divide_bodies():
    assert [[link.name for link in body] for body in bodies(chain(*CHAIN))] == [
        ["base_link", "a"],
        ["b", "c"],
    ]


def test_a_link_that_hangs_on_nothing_is_refused():
    with pytest.raises(ValueError, match=r"x\.urdf: link 'b' does not hang on 'base_link'"):
        link_frames(chain(CHAIN[0], CHAIN[1]), (1.0, 1.0, 1.0), {}, "x.urdf")


def test_meshes_are_scaled_before_they_are_turned_and_moved(data):
    text = (
        f'<robot><link name="base_link"><visual><origin xyz="1 1 1" rpy="0 0 {np.pi / 2}"/>'
        '<geometry><mesh filename="a.obj" scale="1 2 1"/></geometry></visual></link></robot>'
    )
    robot = parse_robot(text.encode(), "x.urdf")
    frame = link_frames(robot, (3.0, 1.0, 1.0), {}, "x.urdf")["base_link"]
    pose = shape_pose(robot.links[0].visuals[0], frame, (3.0, 1.0, 1.0))
    # (1, 1, 0) is scaled to (3, 2, 0), turned to (-2, 3, 0); the origin is scaled to (3, 1, 1).
    np.testing.assert_allclose(pose(np.array([[1.0, 1.0, 0.0]])), [(1, 4, 1)])


def test_the_older_form_of_bounding_boxes_says_the_same(dataset, data):
    new = read_model(data, "bottom_cabinet", "cabinet_a")
    (dataset.root / CABINET / "misc/metadata.json").unlink()
    dataset.json(f"{CABINET}/misc/bbox.json", {"min": [-0.4, -0.3, 0.0], "max": [0.4, 0.25, 0.8]})
    old = read_model(data, "bottom_cabinet", "cabinet_a")
    np.testing.assert_allclose(old.box_size, new.box_size)
    np.testing.assert_allclose(old.box_center, new.box_center)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"bbox_size": [1, 1]}, "bbox_size is"),
        ({"bbox_size": [1, 1, 1]}, "base_link_offset is None; allowed: three numbers"),
        ({"bbox_size": "abc", "base_link_offset": [0, 0, 0]}, "bbox_size is abc"),
        ({"bbox_size": [1, 0, 1], "base_link_offset": [0, 0, 0]}, "allowed: sizes above 0"),
        ([], "bbox_size is None"),
    ],
)
def test_bounding_boxes_that_cannot_be_meant_are_refused(dataset, data, metadata, message):
    dataset.json(f"{CABINET}/misc/metadata.json", metadata)
    with pytest.raises(ValueError, match=rf"metadata\.json: .*{message}"):
        read_model(data, "bottom_cabinet", "cabinet_a")


def test_a_model_without_a_bounding_box_is_named(dataset, data):
    (dataset.root / CABINET / "misc/metadata.json").unlink()
    with pytest.raises(ValueError, match=r"cabinet_a: neither misc/metadata\.json nor misc/bbox\.json"):
        read_model(data, "bottom_cabinet", "cabinet_a")


def test_a_model_without_a_base_link_is_named(dataset, data):
    place = dataset.root / CABINET / "cabinet_a.urdf"
    place.write_text(place.read_text().replace("base_link", "root"))
    with pytest.raises(ValueError, match=r"cabinet_a\.urdf: no link 'base_link' on which all others hang"):
        read_model(data, "bottom_cabinet", "cabinet_a")


def test_the_files_of_the_tests_say_what_they_should(dataset):
    metadata = json.loads((dataset.root / CABINET / "misc/metadata.json").read_text())
    np.testing.assert_allclose(metadata["base_link_offset"], (0, -0.025, 0.4))
