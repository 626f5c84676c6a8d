"""What a round robot in the plane can run into, asked in one of two ways.

``SolidObstacles`` asks PyBullet for the distance between the robot and each solid, exactly as they stand.
``MapObstacles`` asks the outlines from which free space is made: what reaches into the robot's height, seen
from above. It needs no physics engine. Round solids count as the polygons around them there, and solids that
lean or narrow as their whole outline, so the map blocks a little more. Source: ours (ADR-0018).
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RobotConfig
from langwm_data.scenes.navigation import obstacle_polygons
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.collision import Solid, Solids

Contacts = Literal["physics", "map"]
XY = tuple[float, float]
Floats = NDArray[np.float64]

_LEVEL = 0.01
"""A gap is one of heights if its direction deviates by less from the vertical; it is in nobody's way."""


class PlanarGap(NamedTuple):
    """How the robot stands to an obstacle where they are closest."""

    distance: float
    """Metres; negative where they overlap."""
    x: float
    """With ``y``: from the obstacle to the robot, of at most unit length."""
    y: float


class Obstacles(Protocol):
    """The obstacles of one scene for one robot, by number."""

    def near(self, xy: XY, reach_m: float) -> list[int]:
        """Those which a robot at ``xy`` may touch when it moves by ``reach_m``; rather too many."""
        ...

    def gap(self, number: int, xy: XY, within_m: float) -> PlanarGap | None:
        """How a robot at ``xy`` stands to one of them, or None if it is further than ``within_m``."""
        ...

    def close(self) -> None:
        """Free what is held; a second call does nothing."""
        ...


def make_obstacles(scene: SceneSpec, robot: RobotConfig, contacts: Contacts) -> Obstacles:
    """The obstacles of ``scene``, asked for in the way ``contacts`` names."""
    if contacts == "map":
        return MapObstacles(obstacle_polygons(scene, robot), robot.radius_m)
    return SolidObstacles(scene, robot)


class SolidObstacles:
    """Solids as PyBullet knows them. Holds the process's physics client until closed."""

    def __init__(self, scene: SceneSpec, robot: RobotConfig) -> None:
        flat = {s.instance for s in scene.surfaces if s.kind != "wall"}
        self._solids = Solids(scene, keep=lambda instance: instance not in flat)
        # The part of the robot above what it drives over.
        self._shape = self._solids.cylinder(robot.radius_m, robot.height_m - robot.clearance_m).shape
        self._middle_m = 0.5 * (robot.clearance_m + robot.height_m)
        self._radius_m = robot.radius_m
        bounds = self._solids.bounds
        in_way = (bounds[:, 1, 2] > robot.clearance_m) & (bounds[:, 0, 2] < robot.height_m)
        self._numbers = np.flatnonzero(in_way)
        self._rects = _Rects(bounds[self._numbers, :, :2].reshape(-1, 4))

    def near(self, xy: XY, reach_m: float) -> list[int]:
        """Those whose bounds are near."""
        return self._numbers[self._rects.near(xy, self._radius_m + reach_m)].tolist()

    def gap(self, number: int, xy: XY, within_m: float) -> PlanarGap | None:
        """How a robot at ``xy`` stands to that solid; None too if it drives over or under it."""
        body = Solid(shape=self._shape, is_hull=False, position=(*xy, self._middle_m))
        gap = self._solids.gap_from(body, number, within_m)
        if gap is None or (gap.distance >= 0 and math.hypot(*gap.normal[:2]) < _LEVEL):
            return None
        return PlanarGap(gap.distance, gap.normal[0], gap.normal[1])

    def close(self) -> None:
        """Let go of the physics client; a second call does nothing."""
        self._solids.close()


class MapObstacles:
    """Convex outlines seen from above."""

    def __init__(self, polygons: Sequence[Floats], radius_m: float) -> None:
        """Take polygons (N, 2), counter-clockwise, in metres."""
        self._radius_m = radius_m
        # A polygon has few corners: for so few numbers plain floats are quicker than arrays.
        self._edges = [_edges(polygon) for polygon in polygons]
        self._rects = _Rects(np.reshape([[*p.min(axis=0), *p.max(axis=0)] for p in polygons], (-1, 4)))

    def near(self, xy: XY, reach_m: float) -> list[int]:
        """Those whose bounds are near."""
        return self._rects.near(xy, self._radius_m + reach_m).tolist()

    def gap(self, number: int, xy: XY, within_m: float) -> PlanarGap | None:
        """How a robot at ``xy`` stands to the outline of that number."""
        (x, y), is_inside, nearest = xy, True, math.inf
        away_x = away_y = 0.0
        for start_x, start_y, edge_x, edge_y, squared in self._edges[number]:
            from_x, from_y = x - start_x, y - start_y
            if edge_x * from_y < edge_y * from_x:
                is_inside = False
            along = min(max((from_x * edge_x + from_y * edge_y) / squared, 0.0), 1.0)
            off_x, off_y = from_x - along * edge_x, from_y - along * edge_y
            if (away := math.hypot(off_x, off_y)) < nearest:
                nearest, away_x, away_y = away, off_x, off_y
        side = -1.0 if is_inside else 1.0
        distance = side * nearest - self._radius_m
        if distance > within_m:
            return None
        scale = side / nearest if nearest > 0 else 0.0
        return PlanarGap(distance, away_x * scale, away_y * scale)

    def close(self) -> None:
        """Nothing is held."""


class _Rects:
    """Axis-aligned rectangles (N, 4): lowest x and y, highest x and y."""

    def __init__(self, rects: Floats) -> None:
        self._low_x, self._low_y, self._high_x, self._high_y = np.ascontiguousarray(rects.T)

    def near(self, xy: XY, reach_m: float) -> NDArray[np.intp]:
        """Numbers of those which come closer than ``reach_m`` to a point along x and along y, ascending."""
        x, y = xy
        is_near = (self._low_x <= x + reach_m) & (self._high_x >= x - reach_m)
        is_near &= (self._low_y <= y + reach_m) & (self._high_y >= y - reach_m)
        return is_near.nonzero()[0]


def _edges(polygon: Floats) -> list[tuple[float, float, float, float, float]]:
    """Start, direction and squared length of every edge that has a length."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    rows = np.column_stack([polygon, edges, (edges * edges).sum(axis=1)])
    return [tuple(row) for row in rows[rows[:, 4] > 0].tolist()]
