"""URDF and its extension iGSDF: which links, joints and meshes a file describes, in its own units and frames.

Source: the URDF specification (ROS wiki); iGibson 1.0 igibson_indoor_scene.py (iGSDF).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.igibson.xml import Element, parse_xml
from langwm_data.scenes.spec import Vec3

Floats = NDArray[np.float64]

_MAX_VALUE = 1e4
"""Metres or radians: nothing in a home is farther away."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """A frame in that of its parent: first turned about the fixed x, y, z, then moved."""

    xyz: Vec3 = (0.0, 0.0, 0.0)
    rpy: Vec3 = (0.0, 0.0, 0.0)

    def rotation(self) -> Floats:
        """(3, 3)."""
        roll, pitch, yaw = self.rpy
        return turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One mesh of a link."""

    file: str
    """As written."""
    origin: Origin
    scale: Vec3


@dataclass(frozen=True, kw_only=True)
class Link:
    """One link with what is seen of it and what it collides with."""

    name: str
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """How a link hangs on another."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Origin
    axis: Vec3
    limits: tuple[float, float]
    """Radians or metres."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """All links and joints of a URDF file."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


@dataclass(frozen=True, kw_only=True)
class Placed:
    """An object of an iGSDF scene and where it stands."""

    name: str
    category: str
    model: str
    rooms: tuple[str, ...]
    bounding_box: Vec3 | None
    scale: Vec3 | None
    random_group: str
    origin: Origin
    """Of the centre of its bounding box."""


def parse_robot(data: bytes, label: str) -> Robot:
    """The links and joints of a URDF file.

    Raises:
        ValueError: If it is damaged or hostile.
    """
    root = _root(data, label)
    links = tuple(_link(element, label) for element in root.all("link"))
    joints = tuple(_joint(element, label) for element in root.all("joint"))
    names = [link.name for link in links]
    if not names or len(set(names)) != len(names):
        raise ValueError(
            f"{label}: {len(names)} links of {len(set(names))} names; allowed: at least one,"
            " each with a name of its own"
        )
    children = [joint.child for joint in joints]
    if len(set(children)) != len(children):
        raise ValueError(f"{label}: a link is the child of two joints")
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in names:
                raise ValueError(f"{label}: joint {joint.name!r} names link {name!r}, which is not there")
    return Robot(links=links, joints=joints)


def parse_scene(data: bytes, label: str) -> tuple[Placed, ...]:
    """The objects of an iGSDF file, in its order.

    Raises:
        ValueError: If it is damaged or hostile.
    """
    root = _root(data, label)
    joints = {_child(joint, label): joint for joint in root.all("joint")}
    placed = []
    for link in root.all("link"):
        name = _attribute(link, "name", label)
        if "category" in link.attributes:
            if name not in joints:
                raise ValueError(f"{label}: no joint says where {name!r} stands")
            placed.append(_placed(link, joints[name], label))
        elif name != "world":
            raise ValueError(f"{label}: link {name!r} has no category; allowed: objects of a category")
    if len({p.name for p in placed}) != len(placed):
        raise ValueError(f"{label}: two objects have the same name")
    return tuple(placed)


def turn(axis: Vec3, angle_rad: float) -> Floats:
    """(3, 3), the rotation about a unit axis."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross


def _root(data: bytes, label: str) -> Element:
    root = parse_xml(data, label)
    if root.tag != "robot":
        raise ValueError(f"{label}: the outer element is {root.tag[:40]!r}; allowed: 'robot'")
    return root


def _placed(link: Element, joint: Element, label: str) -> Placed:
    attributes, name = link.attributes, link.attributes["name"]
    box, scale = attributes.get("bounding_box"), attributes.get("scale")
    if box is not None and scale is not None:
        raise ValueError(f"{label}: {name!r} has both bounding_box and scale; allowed: one of them")
    return Placed(
        name=name,
        category=_attribute(link, "category", label),
        model=_attribute(link, "model", label),
        rooms=tuple(room for room in attributes.get("room", "").split(",") if room),
        bounding_box=None if box is None else _positive(box, f"{label}: bounding_box of {name!r}"),
        scale=None if scale is None else _positive(scale, f"{label}: scale of {name!r}"),
        random_group=attributes.get("random_group", ""),
        origin=_origin(joint, label),
    )


def _link(element: Element, label: str) -> Link:
    return Link(
        name=_attribute(element, "name", label),
        visuals=tuple(_shapes(element, "visual", label)),
        collisions=tuple(_shapes(element, "collision", label)),
    )


def _shapes(link: Element, tag: str, label: str) -> list[Shape]:
    shapes = []
    for element in link.all(tag):
        geometry = element.first("geometry")
        mesh = None if geometry is None else geometry.first("mesh")
        if mesh is None:
            name = link.attributes["name"]
            raise ValueError(f"{label}: a {tag} of link {name!r} has no mesh; allowed: meshes")
        scale = mesh.attributes.get("scale", "1 1 1")
        shapes.append(
            Shape(
                file=_attribute(mesh, "filename", label),
                origin=_origin(element, label),
                scale=_vector(scale.split() * (3 if len(scale.split()) == 1 else 1), f"{label}: scale"),
            )
        )
    return shapes


def _joint(element: Element, label: str) -> Joint:
    name, kind = _attribute(element, "name", label), _attribute(element, "type", label)
    if kind not in ("fixed", "floating", "revolute", "continuous", "prismatic"):
        raise ValueError(
            f"{label}: joint {name!r} is of type {kind!r};"
            " allowed: fixed, floating, revolute, continuous, prismatic"
        )
    parent, axis, limit = element.first("parent"), element.first("axis"), element.first("limit")
    if parent is None:
        raise ValueError(f"{label}: joint {name!r} has no parent")
    limits = {} if limit is None else limit.attributes
    low, high = (
        _number(limits.get(key, "0"), f"{label}: {key} limit of {name!r}") for key in ("lower", "upper")
    )
    return Joint(
        name=name,
        kind=kind,
        parent=_attribute(parent, "link", label),
        child=_child(element, label),
        origin=_origin(element, label),
        axis=_vector(
            (axis.attributes if axis else {}).get("xyz", "1 0 0").split(), f"{label}: axis of {name!r}"
        ),
        limits=(low, high),
    )


def _child(joint: Element, label: str) -> str:
    child = joint.first("child")
    if child is None:
        raise ValueError(f"{label}: joint {joint.attributes.get('name', '')!r} has no child")
    return _attribute(child, "link", label)


def _origin(element: Element, label: str) -> Origin:
    origin = element.first("origin")
    if origin is None:
        return Origin()
    values = origin.attributes
    return Origin(
        xyz=_vector(values.get("xyz", "0 0 0").split(), f"{label}: xyz of an origin"),
        rpy=_vector(values.get("rpy", "0 0 0").split(), f"{label}: rpy of an origin"),
    )


def _attribute(element: Element, name: str, label: str) -> str:
    value = element.attributes.get(name)
    if not value:
        raise ValueError(f"{label}: a {element.tag[:40]!r} without {name!r}")
    return value


def _positive(text: str, what: str) -> Vec3:
    vector = _vector(text.split(), what)
    if min(vector) <= 0:
        raise ValueError(f"{what} is {text[:60]!r}; allowed: three numbers above 0")
    return vector


def _vector(words: list[str], what: str) -> Vec3:
    if len(words) != 3:
        raise ValueError(f"{what} is {' '.join(words)[:60]!r}; allowed: three numbers")
    x, y, z = (_number(word, what) for word in words)
    return (x, y, z)


def _number(word: str, what: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not abs(value) <= _MAX_VALUE:
        raise ValueError(f"{what} has {word[:40]!r}; allowed: numbers within ±{_MAX_VALUE:g}")
    return value
