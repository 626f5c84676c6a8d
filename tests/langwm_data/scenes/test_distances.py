"""Shortest ways against another program on the same grid, and what lies between the middles of cells."""

import math

import networkx as nx
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from langwm_data.baking import open_scenes
from langwm_data.config import RobotConfig, ScenesConfig
from langwm_data.scenes.navigation import FreeSpace

FLOORS = ("Alder_1", "Maple_0")
NUM_GOALS, NUM_STARTS = 10, 10
REACHES = [(a, b) for a in range(-2, 3) for b in range(-2, 3) if math.gcd(a, b) == 1]


@pytest.fixture(scope="module", params=FLOORS)
def space(request):
    scene = open_scenes(ScenesConfig()).load(request.param)
    # A coarser grid than usual, for a graph that is quickly made and searched.
    return FreeSpace.from_scene(scene, robot=RobotConfig(), resolution_m=0.1)


def touched(cell, move):
    """Cells through whose inside, or by whose corner, the line between two middles goes."""
    points = np.linspace(0, 1, 401)[1:-1, None] * move + np.array(cell) + 0.5
    around = [np.floor(points + np.array(d)) for d in [(e, f) for e in (-1e-6, 1e-6) for f in (-1e-6, 1e-6)]]
    return {tuple(map(int, p)) for p in np.concatenate(around)}


def make_graph(grid):
    """All sixteen moves between free cells that touch free cells alone."""
    graph = nx.Graph()
    cells = [tuple(c) for c in np.argwhere(grid).tolist()]
    graph.add_nodes_from(cells)
    offsets = {move: touched((0, 0), move) for move in REACHES}
    free = set(cells)
    for i, j in cells:
        for (a, b), between in offsets.items():
            end = (i + a, j + b)
            if end in free and all((i + p, j + q) in free for p, q in between):
                graph.add_edge((i, j), end, weight=math.hypot(a, b))
    return graph


def sees(grid, point, cell):
    """Whether a straight line in free cells leads from a point to the middle of a cell."""
    end = np.array(cell) + 0.5
    num = 2 + int(np.linalg.norm(end - point) / 0.02)
    i, j = np.floor(point + np.linspace(0, 1, num)[:, None] * (end - point)).astype(int).T
    return bool(grid[i, j].all())


def test_two_hundred_distances_are_those_of_another_dijkstra(space):
    graph, rng = make_graph(space.grid), np.random.default_rng(0)
    cells = np.argwhere(space.grid)
    differences = []
    for _ in range(NUM_GOALS):
        goal = space.sample(rng)
        field = space.distance_field(goal)
        at = (goal - space.origin) / space.resolution_m
        for cell, away in zip(cells.tolist(), np.linalg.norm(cells + 0.5 - at, axis=1), strict=True):
            if sees(space.grid, at, cell):
                graph.add_edge("goal", tuple(cell), weight=float(away))
        lengths = nx.single_source_dijkstra_path_length(graph, "goal")
        graph.remove_node("goal")
        for i, j in rng.permutation(cells)[:NUM_STARTS].tolist():
            expected = lengths[i, j] * space.resolution_m
            differences.append(field.values[i, j] - expected)
            assert field.values[i, j] == pytest.approx(expected, abs=0.02)
    # What is barely seen past a corner is a matter of how rays are drawn; all else is the same number.
    assert len(differences) == NUM_GOALS * NUM_STARTS
    assert np.mean(np.abs(differences) < 1e-9) > 0.8


def test_between_cells_distances_are_bilinear(space):
    rng = np.random.default_rng(1)
    field = space.distance_field(space.sample(rng))
    middles = [
        o + (np.arange(n) + 0.5) * space.resolution_m
        for o, n in zip(space.origin, space.grid.shape, strict=True)
    ]
    bilinear = RegularGridInterpolator(middles, field.values)
    num_compared = 0
    for _ in range(200):
        point = space.sample(rng)
        corner = np.floor((point - space.origin) / space.resolution_m - 0.5).astype(int)
        around = field.values[corner[0] : corner[0] + 2, corner[1] : corner[1] + 2]
        if np.isfinite(around).all() and np.linalg.norm(point - field.goal) > 0.4:
            num_compared += 1
            assert field.distance(point) == pytest.approx(float(bilinear(point)[0]), abs=1e-9)
    assert num_compared > 150


def test_beyond_the_grid_there_is_no_distance(space):
    field = space.distance_field(space.sample(np.random.default_rng(2)))
    low = np.array(space.origin)
    high = low + np.array(space.grid.shape) * space.resolution_m
    for point in (low - 0.2, high + 0.2, (low[0] - 50, low[1]), (high[0], high[1] + 50)):
        assert field.distance(point) == math.inf
