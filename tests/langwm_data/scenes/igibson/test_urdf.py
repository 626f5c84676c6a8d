"""URDF and iGSDF are read as they stand; what cannot be meant is refused in one sentence."""

import numpy as np
import pytest

from langwm_data.scenes.igibson.urdf import Origin, parse_robot, parse_scene, turn

LINKS = '<link name="base_link"/><link name="lid"/>'


def robot(inner):
    return f"<robot>{inner}</robot>".encode()


def joint(attributes='name="j" type="fixed"', parent="base_link", child="lid", inner=""):
    return f'<joint {attributes}><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'


def test_a_robot_is_read_with_its_meshes_and_joints():
    text = (
        '<link name="base_link"><visual><origin xyz="1 2 3" rpy="0 0 1"/><geometry>'
        '<mesh filename="a.obj" scale="2 2 2"/></geometry></visual>'
        '<collision><geometry><mesh filename="c.obj"/></geometry></collision></link><link name="lid"/>'
        + joint('name="hinge" type="revolute"', inner='<axis xyz="0 0 1"/><limit lower="-1" upper="1.5"/>')
    )
    read = parse_robot(robot(text), "x.urdf")
    (shape,) = read.links[0].visuals
    assert (shape.file, shape.scale, shape.origin) == (
        "a.obj",
        (2, 2, 2),
        Origin(xyz=(1, 2, 3), rpy=(0, 0, 1)),
    )
    assert read.links[0].collisions[0].scale == (1, 1, 1)
    (hinge,) = read.joints
    assert (hinge.kind, hinge.axis, hinge.limits, hinge.origin) == (
        "revolute",
        (0, 0, 1),
        (-1, 1.5),
        Origin(),
    )


def test_angles_turn_about_fixed_axes_one_after_the_other():
    rotation = Origin(rpy=(np.pi / 2, 0.0, np.pi / 2)).rotation()
    # About x: y to z. Then about z: x to y, z stays.
    np.testing.assert_allclose(rotation @ (0, 1, 0), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(rotation @ (1, 0, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(turn((0, 1, 0), np.pi / 2) @ (0, 0, 1), (1, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"<house/>", "the outer element is 'house'"),
        (robot(""), "0 links of 0 names"),
        (robot('<link name="a"/><link name="a"/>'), "2 links of 1 names"),
        (robot("<link/>"), "a 'link' without 'name'"),
        (
            robot('<link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'),
            "has no mesh",
        ),
        (robot(LINKS + joint() + joint('name="k" type="fixed"')), "the child of two joints"),
        (robot(LINKS + joint(parent="nobody")), "joint 'j' names link 'nobody'"),
        (robot(LINKS + joint('name="j" type="ball"')), "joint 'j' is of type 'ball'"),
        (robot(LINKS + '<joint name="j" type="fixed"><child link="lid"/></joint>'), "'j' has no parent"),
        (robot(LINKS + '<joint name="j" type="fixed"><parent link="lid"/></joint>'), "'j' has no child"),
        (robot(LINKS + joint(inner='<origin xyz="1 2"/>')), "xyz of an origin is '1 2'; allowed: three"),
        (robot(LINKS + joint(inner='<origin xyz="1 2 nan"/>')), "has 'nan'; allowed: numbers within"),
        (robot(LINKS + joint(inner='<origin xyz="1 2 1e9"/>')), "has '1e9'; allowed: numbers within"),
        (robot(LINKS + joint(inner='<limit upper="wide"/>')), "upper limit of 'j' has 'wide'"),
    ],
)
def test_robots_that_cannot_be_meant_are_refused(data, message):
    with pytest.raises(ValueError, match=rf"x\.urdf: .*{message}"):
        parse_robot(data, "x.urdf")


def scene(attributes='category="chair" model="a"', name="chair_0", with_joint=True):
    where = (
        joint(parent="world", child=name, inner='<origin xyz="1 2 3" rpy="0 0 0.5"/>') if with_joint else ""
    )
    return robot(f'<link name="world"/><link name="{name}" {attributes}/>{where}')


def test_a_scene_says_what_stands_where():
    attributes = 'category="chair" model="random" random_group="3" room="a_0,b_1" bounding_box="1 2 3"'
    (chair,) = parse_scene(scene(attributes), "s.urdf")
    assert (chair.name, chair.category, chair.model, chair.random_group) == (
        "chair_0",
        "chair",
        "random",
        "3",
    )
    assert (chair.rooms, chair.bounding_box, chair.scale) == (("a_0", "b_1"), (1, 2, 3), None)
    assert chair.origin == Origin(xyz=(1, 2, 3), rpy=(0, 0, 0.5))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (scene(with_joint=False), "no joint says where 'chair_0' stands"),
        (robot('<link name="lost"/>'), "link 'lost' has no category"),
        (scene('category="chair"'), "a 'link' without 'model'"),
        (scene('category="c" model="m" bounding_box="1 1 1" scale="1 1 1"'), "both bounding_box and scale"),
        (scene('category="c" model="m" bounding_box="1 0 1"'), "bounding_box of 'chair_0' is '1 0 1'"),
        (scene('category="c" model="m" scale="-1 1 1"'), "scale of 'chair_0' is '-1 1 1'"),
        (
            scene().replace(b"</robot>", b'<link name="chair_0" category="c" model="m"/></robot>'),
            "the same name",
        ),
    ],
)
def test_scenes_that_cannot_be_meant_are_refused(data, message):
    with pytest.raises(ValueError, match=rf"s\.urdf: .*{message}"):
        parse_scene(data, "s.urdf")
