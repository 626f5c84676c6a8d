"""Object models: from a URDF, a scale and the positions of its joints to rigid bodies.

Source: iGibson 1.0 articulated_object.py, urdf_utils.py. There, too, the scale along x, y and z is that of
the outer frame in every link's own frame, whatever way the link is turned.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.meshes import Pose
from langwm_data.scenes.igibson.urdf import Joint, Link, Robot, Shape, parse_robot, turn
from langwm_data.scenes.spec import Vec3

Floats = NDArray[np.float64]

BASE = "base_link"


@dataclass(frozen=True, kw_only=True)
class Model:
    """One object model as its files describe it."""

    path: str
    """Of its URDF."""
    folder: str
    robot: Robot
    box_size: Vec3
    """Of its bounding box, before scaling."""
    box_center: Vec3
    """Of that box, in the frame of the base link."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A link's frame in that of the base link."""

    rotation: Floats
    """(3, 3)."""
    offset: Floats
    """(3,), metres."""


def read_model(data: DataFolder, category: str, name: str) -> Model:
    """A model of a category.

    Raises:
        ValueError: If it is not there, or damaged.
    """
    folder = f"objects/{category}/{name}"
    path = f"{folder}/{name}.urdf"
    robot = parse_robot(data.read(path), path)
    if BASE not in [link.name for link in robot.links] or BASE in [joint.child for joint in robot.joints]:
        raise ValueError(f"{path}: no link {BASE!r} on which all others hang")
    link_frames(robot, (1.0, 1.0, 1.0), {}, path)
    size, center = _box(data, folder)
    return Model(path=path, folder=folder, robot=robot, box_size=size, box_center=center)


def link_frames(robot: Robot, scale: Vec3, positions: Mapping[str, float], label: str) -> dict[str, Frame]:
    """Where each link is.

    Args:
        robot: Links and joints.
        scale: Along the axes of the base link.
        positions: Of joints by name, radians or metres; zero where nothing is said.
        label: What messages call the file.

    Raises:
        ValueError: If a link does not hang on the base link.
    """
    frames = {BASE: Frame(rotation=np.eye(3), offset=np.zeros(3))}
    left = list(robot.joints)
    while left:
        ready = [joint for joint in left if joint.parent in frames]
        if not ready:
            break
        for joint in ready:
            frames[joint.child] = _moved(frames[joint.parent], joint, scale, positions.get(joint.name, 0.0))
        left = [joint for joint in left if joint not in ready]
    loose = [link.name for link in robot.links if link.name not in frames]
    if loose:
        raise ValueError(f"{label}: link {loose[0]!r} does not hang on {BASE!r}")
    return frames


def bodies(robot: Robot) -> list[list[Link]]:
    """Links that move together, the body of the base link first; a floating joint divides two bodies."""
    body_of = {BASE: BASE}
    left = [joint for joint in robot.joints if joint.child != BASE]
    while left:
        for joint in [j for j in left if j.parent in body_of]:
            body_of[joint.child] = joint.child if joint.kind == "floating" else body_of[joint.parent]
        left = [joint for joint in left if joint.child not in body_of]
    roots = dict.fromkeys(body_of.values())
    return [[link for link in robot.links if body_of[link.name] == root] for root in roots]


def shape_pose(shape: Shape, frame: Frame, scale: Vec3) -> Pose:
    """From a mesh's file to the frame of the base link: scaled, turned and moved in its link's frame."""
    inner = shape.origin.rotation() @ np.diag(np.multiply(shape.scale, scale))
    offset = np.multiply(shape.origin.xyz, scale)
    return Pose(matrix=frame.rotation @ inner, offset=frame.rotation @ offset + frame.offset)


def _moved(parent: Frame, joint: Joint, scale: Vec3, position: float) -> Frame:
    offset = parent.rotation @ np.multiply(joint.origin.xyz, scale) + parent.offset
    rotation = parent.rotation @ joint.origin.rotation()
    if position:
        axis = np.multiply(joint.axis, scale)
        axis = axis / np.linalg.norm(axis)
        if joint.kind == "prismatic":
            offset = offset + rotation @ axis * position
        else:
            x, y, z = axis.tolist()
            rotation = rotation @ turn((x, y, z), position)
    return Frame(rotation=rotation, offset=offset)


def _box(data: DataFolder, folder: str) -> tuple[Vec3, Vec3]:
    """Size and centre of the bounding box."""
    path, old = f"{folder}/misc/metadata.json", f"{folder}/misc/bbox.json"
    if data.has(path):
        content = data.read_json(path)
        size, center = (_triple(content, key, path) for key in ("bbox_size", "base_link_offset"))
    elif data.has(old):
        content = data.read_json(old)
        low, high = (np.array(_triple(content, key, old)) for key in ("min", "max"))
        path, size, center = old, tuple((high - low).tolist()), tuple(((low + high) / 2).tolist())
    else:
        raise ValueError(f"{folder}: neither misc/metadata.json nor misc/bbox.json is there")
    if min(size) <= 0:
        raise ValueError(f"{path}: a bounding box of {size}; allowed: sizes above 0")
    return size, center


def _triple(content: object, key: str, path: str) -> Vec3:
    values = content.get(key) if isinstance(content, dict) else None
    try:
        x, y, z = (float(value) for value in values)  # pyright: ignore[reportOptionalIterable]
    except (TypeError, ValueError):
        x = y = z = np.nan
    if not np.isfinite([x, y, z]).all():
        raise ValueError(f"{path}: {key} is {str(values)[:60]}; allowed: three numbers")
    return (x, y, z)
