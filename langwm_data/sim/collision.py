"""The solids of a scene as PyBullet shapes, and how far they are from each other.

Boxes and upright round cylinders are exact; other shapes are the convex hull of their mesh. Shapes are
asked about where they stand, without bodies: a body takes PyBullet a hundred times as long to make. All
solids of a process share one client, as each takes some 30 MiB.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.geometry import Boxes
from langwm_data.scenes.spec import IDENTITY, PartSpec, Quat, SceneSpec, Vec3
from langwm_data.sim.bullet import connect, import_pybullet
from langwm_data.sim.mesh import part_mesh

_NORMAL, _DISTANCE = 7, 8
"""Places in a contact point. Source: PyBullet Quickstart Guide, getContactPoints."""


@dataclass(frozen=True, kw_only=True)
class Gap:
    """How two solids stand to each other where they are closest."""

    distance: float
    """Metres; negative where they overlap."""
    normal: Vec3
    """Unit vector from the second solid to the first."""


@dataclass(frozen=True, kw_only=True)
class Solid:
    """A shape and where it stands."""

    shape: int
    """In the shared client."""
    is_hull: bool
    position: Vec3
    orientation: Quat = IDENTITY


class Solids:
    """The parts of a scene, each one solid, numbered in their order. Holds the shared client until closed."""

    def __init__(self, scene: SceneSpec, keep: Callable[[int], bool] = lambda _: True) -> None:
        """Take all parts of the instances that ``keep`` accepts."""
        parts = [entry for entry in scene.iter_parts() if keep(entry[0])]
        self.instances = np.array([instance for instance, *_ in parts], np.int64)
        self.bounds: NDArray[np.float64] = Boxes.of_parts(entry[1:] for entry in parts).bounds
        """(N, 2, 3): lowest and highest corner of every solid; too large rather than too small."""
        _shared.acquire()
        self._is_open = True
        self._solids = [
            _shared.solid(part, *part_pose(position, orientation, part))
            for _, position, orientation, part in parts
        ]

    def near(self, low: Vec3, high: Vec3) -> NDArray[np.intp]:
        """Numbers of the solids whose bounds meet the given box, ascending."""
        meets = (self.bounds[:, 1] >= low) & (self.bounds[:, 0] <= high)
        return np.flatnonzero(meets.all(axis=1))

    def cylinder(self, radius_m: float, height_m: float) -> Solid:
        """An upright cylinder around the origin that is no part of the scene, for ``gap_from``."""
        size = (2 * radius_m, 2 * radius_m, height_m)
        part = PartSpec(shape="cylinder", size=size, position=(0.0, 0.0, 0.0), slot=0)
        return _shared.solid(part, part.position, IDENTITY)

    def gap(self, first: int, second: int, within_m: float) -> Gap | None:
        """Where two solids are closest, or None if they are further apart than ``within_m``."""
        return _shared.gap(self._solids[first], self._solids[second], within_m)

    def gap_from(self, solid: Solid, number: int, within_m: float) -> Gap | None:
        """The same for a solid that need not be of the scene, and one of the scene."""
        return _shared.gap(solid, self._solids[number], within_m)

    def iter_neighbours(self, within_m: float) -> Iterator[tuple[int, int, Gap]]:
        """Pairs of solids of different instances, as their numbers, no further apart than ``within_m``."""
        for i, (low, high) in enumerate(self.bounds):
            for j in self.near(low - within_m, high + within_m).tolist():
                if j > i and self.instances[j] != self.instances[i]:
                    gap = self.gap(i, j, within_m)
                    if gap is not None:
                        yield i, j, gap

    def close(self) -> None:
        """Let go of the client; a second call does nothing."""
        if self._is_open:
            self._is_open = False
            _shared.release()


class _SharedShapes:
    """Shapes of one client, one for all parts of equal form. The client lives as long as it has users."""

    def __init__(self) -> None:
        self._num_users = 0
        self._client = -1
        self._shapes: dict[PartSpec, int] = {}

    def acquire(self) -> None:
        if self._num_users == 0:
            self._client = connect()
        self._num_users += 1

    def release(self) -> None:
        assert self._num_users > 0, "released more often than acquired"
        self._num_users -= 1
        if self._num_users == 0:
            import_pybullet().disconnect(self._client)
            self._shapes.clear()

    def solid(self, part: PartSpec, position: Vec3, orientation: Quat) -> Solid:
        form = _form(part)
        if form not in self._shapes:
            self._shapes[form] = make_shape(self._client, form)
        shape = self._shapes[form]
        return Solid(shape=shape, is_hull=_is_hull(part), position=position, orientation=orientation)

    def gap(self, first: Solid, second: Solid, within_m: float) -> Gap | None:
        if second.is_hull and not first.is_hull:
            # In this order PyBullet gives the normal of the other one.
            turned = self.gap(second, first, within_m)
            return turned and Gap(distance=turned.distance, normal=_opposite(turned.normal))
        points = import_pybullet().getClosestPoints(
            bodyA=-1,
            bodyB=-1,
            distance=within_m,
            collisionShapeA=first.shape,
            collisionShapePositionA=first.position,
            collisionShapeOrientationA=first.orientation,
            collisionShapeB=second.shape,
            collisionShapePositionB=second.position,
            collisionShapeOrientationB=second.orientation,
            physicsClientId=self._client,
        )
        if not points:
            return None
        closest = min(points, key=lambda point: point[_DISTANCE])
        return Gap(distance=closest[_DISTANCE], normal=closest[_NORMAL])


_shared = _SharedShapes()


def make_shape(client: int, part: PartSpec) -> int:
    """The form of a part as a collision shape of a PyBullet client, its centre at the origin."""
    bullet, (x, y, z) = import_pybullet(), part.size
    if _is_hull(part):
        return bullet.createCollisionShape(
            bullet.GEOM_MESH, vertices=_hull_points(_form(part)), physicsClientId=client
        )
    if part.shape == "cylinder":
        return bullet.createCollisionShape(
            bullet.GEOM_CYLINDER, radius=x / 2, height=z, physicsClientId=client
        )
    half = (x / 2, y / 2, z / 2)
    return bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=client)


def part_pose(position: Vec3, orientation: Quat, part: PartSpec) -> tuple[Vec3, Quat]:
    """Where a part stands in the world, from the pose of its owner."""
    return import_pybullet().multiplyTransforms(position, orientation, part.position, part.orientation)


def _is_hull(part: PartSpec) -> bool:
    return not (part.shape == "box" or (part.shape == "cylinder" and part.size[0] == part.size[1]))


def _form(part: PartSpec) -> PartSpec:
    """The part without its place and material."""
    return dataclasses.replace(part, position=(0.0, 0.0, 0.0), orientation=IDENTITY, slot=0)


def _opposite(vector: Vec3) -> Vec3:
    return (-vector[0], -vector[1], -vector[2])


# Cached because createCollisionShape never frees the lists that it is given: so they are few.
@cache
def _hull_points(form: PartSpec) -> list[list[float]]:
    return [list(p) for p in form.points] if form.shape == "hull" else part_mesh(form).vertices.tolist()
