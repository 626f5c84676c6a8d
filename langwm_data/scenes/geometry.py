"""Oriented boxes, footprints and rotations: the geometry that scenes need and nothing more.

Metres, radians, z up. Round parts count as the boxes around them where overlap is asked for, so the
answer errs towards "they overlap".
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from langwm_data.scenes.spec import IDENTITY, PartSpec, Quat, Rect, Vec3

Array = NDArray[np.float64]

_NUM_SIDES = 16


def yaw_quat(yaw_rad: float) -> Quat:
    """Rotation about z."""
    return (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))


def axis_quat(axis: Vec3, angle_rad: float) -> Quat:
    """Rotation about a unit ``axis``."""
    s = math.sin(angle_rad / 2)
    return (axis[0] * s, axis[1] * s, axis[2] * s, math.cos(angle_rad / 2))


def quat_product(a: Quat, b: Quat) -> Quat:
    """The rotation ``b`` followed by ``a``."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


@lru_cache(maxsize=4096)
def quat_matrix(quat: Quat) -> Array:
    """Unit quaternion (x, y, z, w) to a 3x3 rotation matrix, not writable: most parts share a few."""
    x, y, z, w = quat
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix.setflags(write=False)
    return matrix


@dataclass(frozen=True, kw_only=True)
class Boxes:
    """A batch of oriented boxes."""

    center: Array
    """(N, 3)."""
    axes: Array
    """(N, 3, 3), a box's own axes as columns."""
    half: Array
    """(N, 3), half the extent along each own axis."""

    @classmethod
    def of_parts(cls, parts: Iterable[tuple[Vec3, Quat, PartSpec]]) -> Self:
        """One box around each part, given with the pose of its owner."""
        centers, axes, halves = [], [], []
        for position, orientation, part in parts:
            rotation = quat_matrix(orientation)
            centers.append(rotation @ np.asarray(part.position) + position)
            axes.append(
                rotation if part.orientation == IDENTITY else rotation @ quat_matrix(part.orientation)
            )
            halves.append(np.asarray(part.size) / 2)
        return cls(
            center=np.reshape(centers, (-1, 3)),
            axes=np.reshape(axes, (-1, 3, 3)),
            half=np.reshape(halves, (-1, 3)),
        )

    def __len__(self) -> int:
        return len(self.center)

    @property
    def bounds(self) -> Array:
        """(N, 2, 3): lower and upper corner of the axis-aligned box around each."""
        reach = np.einsum("nij,nj->ni", np.abs(self.axes), self.half)
        return np.stack([self.center - reach, self.center + reach], axis=1)

    def overlap(self, other: Self, *, tolerance_m: float) -> NDArray[np.bool_]:
        """(N, M): which boxes share more than ``tolerance_m`` along every separating direction.

        The separating axis theorem: two convex bodies are apart exactly when some face normal or
        some cross product of their edges separates them.
        """
        n, m = len(self), len(other)
        own = np.broadcast_to(self.axes[:, None], (n, m, 3, 3))
        its = np.broadcast_to(other.axes[None], (n, m, 3, 3))
        cross = np.cross(own[..., :, :, None], its[..., :, None, :], axis=2)
        directions = np.concatenate([own, its, cross.reshape(n, m, 3, 9)], axis=-1)
        length = np.linalg.norm(directions, axis=2, keepdims=True)
        usable = length[:, :, 0] > 1e-6
        directions = directions / np.where(length > 1e-6, length, 1.0)
        reach = _reach(own, self.half[:, None], directions) + _reach(its, other.half[None], directions)
        offset = other.center[None] - self.center[:, None]
        depth = reach - np.abs(np.einsum("nmi,nmik->nmk", offset, directions))
        return np.where(usable, depth, np.inf).min(axis=-1) > tolerance_m


def _reach(axes: Array, half: Array, directions: Array) -> Array:
    along = np.abs(np.einsum("nmij,nmik->nmjk", axes, directions))
    return np.einsum("nmjk,nmj->nmk", along, np.broadcast_to(half, (*along.shape[:2], 3)))


def part_polygon(position: Vec3, orientation: Quat, part: PartSpec) -> Array:
    """What a part covers seen from above: a convex polygon (N, 2), counter-clockwise.

    Round parts give the polygon around them, so nothing sticks out of it.
    """
    rotation = quat_matrix(orientation) @ quat_matrix(part.orientation)
    center = quat_matrix(orientation) @ np.asarray(part.position) + position
    if part.shape == "hull":
        points = np.asarray(part.points) @ rotation.T + center
        return points[ConvexHull(points[:, :2]).vertices, :2]
    outline = _outline(part)
    if rotation[2, 2] > 1 - 1e-9:
        return outline @ rotation[:2, :2].T + center[:2]
    top = np.column_stack([outline, np.full(len(outline), part.size[2] / 2)])
    points = np.concatenate([top, top * (1, 1, -1)]) @ rotation.T + center
    return points[ConvexHull(points[:, :2]).vertices, :2]


def _outline(part: PartSpec) -> Array:
    half = np.asarray(part.size[:2]) / 2
    if part.shape == "box":
        return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    angles = np.arange(_NUM_SIDES) * 2 * np.pi / _NUM_SIDES
    return np.column_stack([np.cos(angles), np.sin(angles)]) * half / np.cos(np.pi / _NUM_SIDES)


def rects_overlap(a: Rect, b: Rect, gap_m: float = 0.0) -> bool:
    """Whether two axis-aligned rectangles come closer than ``gap_m`` in both directions."""
    e = 1e-9 - gap_m
    return a[0] < b[2] - e and b[0] < a[2] - e and a[1] < b[3] - e and b[1] < a[3] - e


def point_polygon_distance(points: Array, polygon: Array) -> Array:
    """Distance (K,) from points (K, 2) to a convex counter-clockwise polygon, 0 inside."""
    edge_x, edge_y = (np.concatenate([polygon[1:], polygon[:1]]) - polygon).T
    x, y = points[:, :1] - polygon[:, 0], points[:, 1:] - polygon[:, 1]
    t = (x * edge_x + y * edge_y) / np.maximum(edge_x * edge_x + edge_y * edge_y, 1e-18)
    t = np.minimum(np.maximum(t, 0), 1)
    gap_x, gap_y = x - t * edge_x, y - t * edge_y
    distance = np.sqrt((gap_x * gap_x + gap_y * gap_y).min(axis=1))
    inside = (edge_x * y - edge_y * x >= 0).all(axis=1)
    return np.where(inside, 0.0, distance)
