"""Where the robot can be, and how far it is from there to a goal.

Owns the free space of a scene and shortest paths in it. World coordinates, metres. Solids limit it, and the
map that a scene may bring along (ADR-0011).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from langwm_data.config import RobotConfig
from langwm_data.scenes.geometry import Array, Boxes, part_polygon, point_polygon_distance
from langwm_data.scenes.gridpaths import (
    in_sight,
    largest_component,
    move_graph,
    spread,
    spread_once,
    with_source,
)
from langwm_data.scenes.spec import SceneSpec

RESOLUTION_M = 0.05
"""At 0.1 m, ways between furniture that the robot fits through close, and detours of up to a half
appear; at 0.05 m, lengths differ from those at 0.02 m by 0.7 % on average."""

_BLEND_M = (0.2, 0.4)
"""Nearer to the goal than the first, distances are straight lines; beyond the second, the field's."""


class FreeSpace:
    """The largest connected area in which the centre of a round robot can be.

    A cell of the grid is free when a robot that stands at its middle touches nothing.
    """

    def __init__(
        self,
        clearance: Array,
        origin: tuple[float, float],
        resolution_m: float,
        radius_m: float,
        obstacles: list[Array],
    ) -> None:
        free = clearance >= radius_m
        self.grid = largest_component(free)
        """(X, Y): first index along x."""
        self.origin = origin
        """Outer corner of cell (0, 0)."""
        self.resolution_m = resolution_m
        self.radius_m = radius_m
        # Somewhere in these cells the robot can stand, though not at their middle.
        self._tight = (clearance >= radius_m - resolution_m / np.sqrt(2)) & ~free
        self._cells = np.argwhere(self.grid)
        self._obstacles = obstacles
        self._bounds = _bounds(obstacles)

    @classmethod
    def from_scene(cls, scene: SceneSpec, *, robot: RobotConfig, resolution_m: float = RESOLUTION_M) -> Self:
        """The free space of a scene for a robot.

        Args:
            scene: The scene; parts between what the robot drives over and its top are in its way, and
                cells outside of its floor map, if it has one, are no place for it.
            robot: Radius, height and clearance.
            resolution_m: Edge of a grid cell. Finer cells find narrower ways and cost more.

        Raises:
            ValueError: If the robot fits nowhere.
        """
        obstacles = obstacle_polygons(scene, robot)
        rects = np.array([room.rect for room in scene.rooms])
        low, high = rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)
        shape = np.ceil((high - low) / resolution_m - 1e-9).astype(int)
        origin = (float(low[0]), float(low[1]))
        centers = _centers(shape, origin, resolution_m)
        clearance = np.full(tuple(shape), np.inf)
        for polygon, window in zip(
            obstacles, _windows(_bounds(obstacles), origin, resolution_m, robot.radius_m, shape), strict=True
        ):
            near = centers[window]
            distance = point_polygon_distance(near.reshape(-1, 2), polygon)
            clearance[window] = np.minimum(clearance[window], distance.reshape(near.shape[:2]))
        if scene.floor_map is not None:
            clearance[~scene.floor_map.free_at(centers)] = 0
        if not (clearance >= robot.radius_m).any():
            raise ValueError(
                f"scene {scene.name!r} has no room for a robot of radius {robot.radius_m} m;"
                " allowed: a radius smaller than the free space"
            )
        return cls(clearance, origin, resolution_m, robot.radius_m, obstacles)

    @cached_property
    def _graph(self) -> csr_array:
        """Moves between free cells; made when the first distances are asked for."""
        return move_graph(self.grid)

    @property
    def area_m2(self) -> float:
        """Area in which the robot's centre can be."""
        return float(self.grid.sum()) * self.resolution_m**2

    def cell(self, xy: ArrayLike) -> tuple[int, int]:
        """The cell in which a point lies; it may lie outside the grid."""
        i, j = np.floor((np.asarray(xy, float) - self.origin) / self.resolution_m).astype(int)
        return int(i), int(j)

    def center(self, cell: ArrayLike) -> Array:
        """Middles of cells, (..., 2)."""
        return (np.asarray(cell) + 0.5) * self.resolution_m + self.origin

    def is_free(self, xy: ArrayLike) -> bool:
        """Whether the robot can stand exactly here and drive from here to everywhere else."""
        return self._is_in_free_cell(xy) and self.clearance(xy) >= self.radius_m

    def sample(self, rng: np.random.Generator) -> Array:
        """A point (2,) where the robot can stand, uniform over all of them."""
        return self.sample_place(rng)[0]

    def sample_place(self, rng: np.random.Generator) -> tuple[Array, float]:
        """The same, and its clearance in metres."""
        while True:
            cell = self._cells[rng.integers(len(self._cells))]
            xy = self.center(cell) + rng.uniform(-0.5, 0.5, 2) * self.resolution_m
            if self._is_in_free_cell(xy) and (clearance := self.clearance(xy)) >= self.radius_m:
                return xy, clearance

    def clearance(self, xy: ArrayLike) -> float:
        """Distance from a point to the nearest thing in the robot's height, 0 inside one."""
        point = np.asarray(xy, float)
        outside = np.maximum(np.maximum(self._bounds[:, :2] - point, point - self._bounds[:, 2:]), 0)
        lower_bound = np.hypot(outside[:, 0], outside[:, 1])
        if not len(lower_bound):
            return np.inf
        # The one whose bounds are nearest comes first: hardly any other can then be nearer.
        first = int(lower_bound.argmin())
        nearest = self._distance_to(first, point)
        for i in np.flatnonzero(lower_bound < nearest).tolist():
            if i != first:
                nearest = min(nearest, self._distance_to(i, point))
        return nearest

    def _distance_to(self, obstacle: int, point: Array) -> float:
        return float(point_polygon_distance(point[None], self._obstacles[obstacle])[0])

    def _is_in_free_cell(self, xy: ArrayLike) -> bool:
        i, j = self.cell(xy)
        return 0 <= i < self.grid.shape[0] and 0 <= j < self.grid.shape[1] and bool(self.grid[i, j])

    def distance_field(self, goal_xy: ArrayLike) -> "DistanceField":
        """Distances from everywhere to a goal.

        Raises:
            ValueError: If the robot cannot stand at the goal.
        """
        goal = np.asarray(goal_xy, float)
        if not self.is_free(goal):
            raise ValueError(
                f"goal ({goal[0]:.2f}, {goal[1]:.2f}) is not free; allowed: points where the robot can stand"
            )
        at = (goal - self.origin) / self.resolution_m
        seen = in_sight(self.grid, at)
        cells = self._cells
        near = np.flatnonzero(seen[self.grid])
        # A length of zero would read as no move at all.
        straight = np.maximum(np.linalg.norm(cells[near] + 0.5 - at, axis=1), 1e-9)
        graph = with_source(self._graph, near, straight)
        length, before = dijkstra(graph, indices=len(cells), return_predecessors=True)
        values = np.full(self.grid.shape, np.inf)
        values[self.grid] = length[:-1]
        values = spread_once(spread(values, self._tight))
        return DistanceField(
            space=self, goal=goal, values=values * self.resolution_m, cells=cells, before=before
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DistanceField:
    """Lengths of the shortest ways to one goal.

    What the goal sees is measured straight; beyond, ways run over the grid in sixteen directions, which makes
    them at most 2.8 % too long, and around gaps that are too tight for the grid (ADR-0005).
    """

    space: FreeSpace
    goal: Array
    values: Array
    """(X, Y), metres at the middle of each cell: free cells and those beside them, else infinite."""
    cells: NDArray[np.intp]
    """(N, 2), the free cells."""
    before: NDArray[np.int32]
    """(N + 1,), the next free cell on the way to the goal; N is the goal itself."""

    def distance(self, xy: Sequence[float] | Array) -> float:
        """Length of the shortest way to the goal, continuous in ``xy``; infinite where there is none.

        A robot that touches something stands between free and blocked cells; it has a distance too.
        """
        x, y = float(xy[0]), float(xy[1])
        straight = math.hypot(x - self._goal_xy[0], y - self._goal_xy[1])
        low, high = _BLEND_M
        weight = min(max((straight - low) / (high - low), 0.0), 1.0)
        return straight if weight == 0 else (1 - weight) * straight + weight * self._interpolate(x, y)

    def path(self, xy: ArrayLike) -> Array:
        """The shortest way from a point to the goal as corners (N, 2), both ends included.

        Raises:
            ValueError: If there is no way.
        """
        point = np.asarray(xy, float)
        at, corners = self._first_cell(point), [point]
        while at < len(self.cells):
            corners.append(self.space.center(self.cells[at]))
            at = int(self.before[at])
        return np.stack([*corners, self.goal])

    @cached_property
    def _goal_xy(self) -> tuple[float, float]:
        return float(self.goal[0]), float(self.goal[1])

    def _interpolate(self, x: float, y: float) -> float:
        """Bilinear between the middles of four cells, of which those without a value are left out."""
        (left, below), cell_m = self.space.origin, self.space.resolution_m
        at_x, at_y = (x - left) / cell_m - 0.5, (y - below) / cell_m - 0.5
        i, j = math.floor(at_x), math.floor(at_y)
        to_right, up = at_x - i, at_y - j
        if not (-1 <= i < self.values.shape[0] and -1 <= j < self.values.shape[1]):
            return math.inf
        total = weights = 0.0
        value = self._framed.item
        for di, wx in ((0, 1 - to_right), (1, to_right)):
            for dj, wy in ((0, 1 - up), (1, up)):
                # For so few numbers plain floats are quicker than arrays.
                distance, weight = value(i + 1 + di, j + 1 + dj), wx * wy
                if distance < math.inf:
                    total += weight * distance
                    weights += weight
        return total / weights if weights > 1e-6 else math.inf

    @cached_property
    def _framed(self) -> Array:
        """The values within a frame of cells without one."""
        return np.pad(self.values, 1, constant_values=np.inf)

    def _first_cell(self, point: Array) -> int:
        """The number of the free cell close to a point from where the whole way is shortest."""
        away = np.linalg.norm(self.space.center(self.cells) - point, axis=1)
        near = np.flatnonzero(away < 3 * self.space.resolution_m)
        if len(near) == 0:
            raise ValueError(
                f"({point[0]:.2f}, {point[1]:.2f}) has no way to the goal; allowed: points in the free space"
            )
        return int(near[np.argmin(away[near] + self.values[tuple(self.cells[near].T)])])


def obstacle_polygons(scene: SceneSpec, robot: RobotConfig) -> list[Array]:
    """What is in the way of the robot, seen from above: convex polygons (N, 2)."""
    parts = [(position, orientation, part) for _, position, orientation, part in scene.iter_parts()]
    bounds = Boxes.of_parts(parts).bounds
    in_way = (bounds[:, 0, 2] < robot.height_m) & (bounds[:, 1, 2] > robot.clearance_m)
    return [part_polygon(*parts[i]) for i in np.flatnonzero(in_way)]


def floor_plan(scene: SceneSpec) -> list[tuple[str, Array]]:
    """A scene seen from above, to be drawn in this order: category and convex polygon (N, 2).

    Floors come first, then things from low to high, then walls; ceilings, what hangs from them and walls
    above doors and windows are left out.
    """
    shapes: list[tuple[float, str, Array]] = []
    table = scene.instances()
    for instance, position, orientation, part in scene.iter_parts():
        category = table[instance][0]
        if category in ("ceiling", "ceiling_lamp"):
            continue
        bottom, top = map(float, Boxes.of_parts([(position, orientation, part)]).bounds[0, :, 2])
        if category == "wall" and bottom > 0:
            continue
        order = {"floor": -1.0, "wall": 99.0}.get(category, top)
        shapes.append((order, category, part_polygon(position, orientation, part)))
    return [(category, polygon) for _, category, polygon in sorted(shapes, key=lambda s: s[0])]


def _centers(shape: NDArray[np.intp], origin: tuple[float, float], resolution_m: float) -> Array:
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    return (cells + 0.5) * resolution_m + origin


def _bounds(polygons: list[Array]) -> Array:
    """(N, 4): lowest x and y, highest x and y of each polygon."""
    return np.reshape([[*p.min(axis=0), *p.max(axis=0)] for p in polygons], (-1, 4))


def _windows(
    bounds: Array, origin: tuple[float, float], resolution_m: float, margin_m: float, shape: NDArray[np.intp]
) -> Iterator[tuple[slice, slice]]:
    """The cells that each polygon can block, from its bounds."""
    low = np.floor((bounds[:, :2] - margin_m - origin) / resolution_m - 0.5).astype(int)
    high = np.ceil((bounds[:, 2:] + margin_m - origin) / resolution_m + 0.5).astype(int)
    for (i0, j0), (i1, j1) in zip(np.clip(low, 0, shape), np.clip(high, 0, shape), strict=True):
        yield slice(i0, i1), slice(j0, j1)
