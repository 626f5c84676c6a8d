"""The solids of a scene in PyBullet, one static body for each part, and questions about distances.

Boxes and upright round cylinders are exact; other shapes are the convex hull of their mesh.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.spec import IDENTITY, PartSpec, Quat, SceneSpec, Vec3
from langwm_data.sim.bullet import import_pybullet, quiet
from langwm_data.sim.mesh import part_mesh


@dataclass(frozen=True, kw_only=True)
class Gap:
    """How two bodies stand to each other where they are closest."""

    distance: float
    """Metres; negative where they overlap."""
    normal: Vec3
    """Unit vector from the second body to the first."""


class Solids:
    """A PyBullet client that holds the parts of a scene as static bodies."""

    def __init__(self, scene: SceneSpec, keep: Callable[[int], bool] = lambda _: True) -> None:
        """Add all parts of the instances that ``keep`` accepts."""
        self.bullet: ModuleType = import_pybullet()
        with quiet():
            self.client: int = self.bullet.connect(self.bullet.DIRECT)
        bodies, instances = [], []
        for instance, position, orientation, part in scene.iter_parts():
            if keep(instance):
                bodies.append(self._add(part, position, orientation))
                instances.append(instance)
        self.bodies = np.array(bodies, np.int64)
        self.instances = np.array(instances, np.int64)
        boxes = [self.bullet.getAABB(body, physicsClientId=self.client) for body in bodies]
        self.bounds: NDArray[np.float64] = np.reshape(boxes, (-1, 2, 3))
        """(N, 2, 3): lowest and highest corner of every body, a little too large rather than too small."""

    def near(self, low: Vec3, high: Vec3) -> NDArray[np.intp]:
        """Indices of the bodies whose bounds meet the given box, in a fixed order."""
        meets = (self.bounds[:, 1] >= low) & (self.bounds[:, 0] <= high)
        return np.flatnonzero(meets.all(axis=1))

    def gap(self, first: int, second: int, within_m: float) -> Gap | None:
        """Where two bodies are closest, or None if they are further apart than ``within_m``."""
        points = self.bullet.getClosestPoints(first, second, within_m, physicsClientId=self.client)
        if not points:
            return None
        closest = min(points, key=lambda p: p[8])
        return Gap(distance=closest[8], normal=closest[7])

    def iter_neighbours(self, within_m: float) -> Iterator[tuple[int, int, Gap]]:
        """Pairs of different instances, as indices of bodies, no further apart than ``within_m``."""
        for i, (low, high) in enumerate(self.bounds):
            for j in self.near(low - within_m, high + within_m):
                if j > i and self.instances[j] != self.instances[i]:
                    gap = self.gap(int(self.bodies[i]), int(self.bodies[j]), within_m)
                    if gap is not None:
                        yield i, int(j), gap

    def close(self) -> None:
        """Free the client; a second call does nothing."""
        if self.client >= 0:
            self.bullet.disconnect(self.client)
            self.client = -1

    def _add(self, part: PartSpec, position: Vec3, orientation: Quat) -> int:
        where, turned = self.bullet.multiplyTransforms(position, orientation, part.position, part.orientation)
        return self.bullet.createMultiBody(
            baseMass=0,
            baseCollisionShapeIndex=self._shape(part),
            basePosition=where,
            baseOrientation=turned,
            physicsClientId=self.client,
        )

    def _shape(self, part: PartSpec) -> int:
        bullet, client = self.bullet, self.client
        x, y, z = part.size
        if part.shape == "box":
            half = (x / 2, y / 2, z / 2)
            return bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
        if part.shape == "cylinder" and x == y:
            return bullet.createCollisionShape(
                bullet.GEOM_CYLINDER, radius=x / 2, height=z, physicsClientId=client
            )
        at_origin = dataclasses.replace(part, position=(0.0, 0.0, 0.0), orientation=IDENTITY, slot=0)
        return bullet.createCollisionShape(
            bullet.GEOM_MESH, vertices=_hull_points(at_origin), physicsClientId=client
        )


# Cached because createCollisionShape never frees the lists that it is given: so they are few.
@cache
def _hull_points(part: PartSpec) -> list[list[float]]:
    return part_mesh(part).vertices.tolist()
