"""Doors of a scene opened as wide as they go, so that one can drive from room to room.

Solids count as their outlines seen from above where their heights meet: a little too large for leaning walls.
Source: iGibson 1.0 igibson_indoor_scene.py, open_all_doors: from the upper limit of each joint of a door
down in steps, to the first position that touches nothing; zero if there is none.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.models import BASE, Frame, link_frames
from langwm_data.scenes.igibson.objects import Instance, link_solids
from langwm_data.scenes.igibson.urdf import Joint

STEP_RAD = math.pi / 36
STEP_M = 0.05
TOUCH_M = 0.02
"""Solids may reach into each other by as much: frames of doors and convex pieces of walls are not exact."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outline:
    """A convex solid seen from above, and between which heights it is."""

    polygon: Floats
    """(N, 2), counter-clockwise."""
    low: float
    high: float


def outline(points: Floats) -> Outline:
    """Of the convex hull of points (N, 3)."""
    try:
        polygon = points[ConvexHull(points[:, :2]).vertices, :2]
    except QhullError:  # seen from above it is a line
        low, high = points[:, :2].min(axis=0) - 1e-4, points[:, :2].max(axis=0) + 1e-4
        polygon = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return Outline(polygon=polygon, low=float(points[:, 2].min()), high=float(points[:, 2].max()))


def open_positions(data: DataFolder, instance: Instance, around: Sequence[Outline]) -> dict[str, float]:
    """How far each joint of a door on its base link opens, radians or metres; nothing where it stays closed.

    Args:
        data: The dataset.
        instance: The door.
        around: What else there is, floors and ceilings aside.
    """
    positions: dict[str, float] = {}
    for joint in instance.model.robot.joints:
        if joint.kind not in ("revolute", "prismatic") or joint.parent != BASE:
            continue
        (link,) = (link for link in instance.model.robot.links if link.name == joint.child)
        closed = _frame(instance, joint, 0.0)
        solids = [
            (points - closed.offset) @ closed.rotation for points in link_solids(data, instance, link, closed)
        ]
        near = _near(instance.to_world(closed.offset[None])[0], solids, around, max(joint.limits))
        for position in _openings(joint, instance):
            frame = _frame(instance, joint, position)
            leaf = [outline(instance.to_world(p @ frame.rotation.T + frame.offset)) for p in solids]
            if not any(_touches(part, other) for part in leaf for other in near):
                positions[joint.name] = position
                break
    return {name: position for name, position in positions.items() if position}


def _openings(joint: Joint, instance: Instance) -> Iterable[float]:
    """Positions from the upper limit down to zero."""
    high, step = joint.limits[1], STEP_RAD
    if joint.limits[0] >= high:  # turns without end
        return ()
    if joint.kind == "prismatic":
        along = int(np.abs(joint.axis).argmax())
        high, step = high * instance.scale[along], STEP_M
    return [high - step * i for i in range(max(math.floor(high / step + 1e-9), -1) + 1)]


def _frame(instance: Instance, joint: Joint, position: float) -> Frame:
    """Of the leaf in the base link."""
    model = instance.model
    return link_frames(model.robot, instance.scale, {joint.name: position}, model.path)[joint.child]


def _near(hinge: Floats, solids: list[Floats], around: Sequence[Outline], slide_m: float) -> list[Outline]:
    """What a leaf can reach at all."""
    reach = max(np.linalg.norm(points, axis=1).max() for points in solids) + slide_m if solids else 0.0
    low, high = hinge[:2] - reach, hinge[:2] + reach
    return [
        other
        for other in around
        if (other.polygon.max(axis=0) >= low).all() and (other.polygon.min(axis=0) <= high).all()
    ]


def _touches(first: Outline, second: Outline) -> bool:
    if min(first.high, second.high) - max(first.low, second.low) <= TOUCH_M:
        return False
    return _overlap_m(first.polygon, second.polygon) > TOUCH_M


def _overlap_m(first: Floats, second: Floats) -> float:
    """How far two convex polygons would have to move to be apart; negative where they are.

    The separating axis theorem in the plane: only directions across an edge can part them.
    """
    edges = np.concatenate([np.roll(p, -1, axis=0) - p for p in (first, second)])
    across = np.stack([edges[:, 1], -edges[:, 0]])
    across = across / np.maximum(np.linalg.norm(across, axis=0), 1e-12)
    a, b = first @ across, second @ across
    return float((np.minimum(a.max(axis=0) - b.min(axis=0), b.max(axis=0) - a.min(axis=0))).min())
