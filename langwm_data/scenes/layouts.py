"""How the rooms of a floor are laid out: which, how large, side by side or around a hallway.

A floor is a rectangle tiled by cells. The inner extent of a room is its cell less half a wall on every
side, so two rooms are always one wall apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from langwm_data.scenes.furniture.openings import WALL_THICKNESS
from langwm_data.scenes.spec import Rect

PlanKind = Literal["flat", "ground", "upper", "attic"]
Cells = list[tuple[str, Rect]]
"""Kind of room and outer rectangle."""
_Program = list[tuple[str, float]]
"""Kind of room and wanted area in square metres."""

PUBLIC = ("hallway", "living_room", "dining_room", "kitchen")
"""Rooms that one walks through; no door joins two others."""


@dataclass(frozen=True, kw_only=True)
class RoomLimits:
    """How large a kind of room is."""

    area_m2: tuple[float, float]
    min_side_m: float


LIMITS: Mapping[str, RoomLimits] = {
    "living_room": RoomLimits(area_m2=(19.0, 27.0), min_side_m=3.7),
    "kitchen": RoomLimits(area_m2=(9.0, 13.0), min_side_m=2.5),
    "dining_room": RoomLimits(area_m2=(11.0, 15.0), min_side_m=2.9),
    "bedroom": RoomLimits(area_m2=(11.5, 17.0), min_side_m=3.0),
    "bathroom": RoomLimits(area_m2=(5.5, 8.0), min_side_m=2.1),
    "study": RoomLimits(area_m2=(8.5, 12.0), min_side_m=2.5),
    "playroom": RoomLimits(area_m2=(10.0, 14.0), min_side_m=2.8),
    "storage_room": RoomLimits(area_m2=(5.0, 7.5), min_side_m=2.0),
}

_PROGRAMS: Mapping[PlanKind, tuple[tuple[str, ...], tuple[str, ...], tuple[int, int]]] = {
    "flat": (
        ("living_room", "kitchen", "bedroom", "bathroom"),
        ("bedroom", "study", "dining_room", "storage_room"),
        (1, 3),
    ),
    "ground": (
        ("living_room", "kitchen", "dining_room", "bathroom"),
        ("study", "storage_room", "bedroom"),
        (1, 2),
    ),
    "upper": (
        ("bedroom", "bedroom", "bathroom"),
        ("study", "bedroom", "playroom", "storage_room", "bathroom"),
        (2, 3),
    ),
    "attic": (("bedroom", "bathroom", "playroom"), ("study", "storage_room", "bedroom", "bedroom"), (2, 3)),
}
"""Rooms always there, rooms to choose from, and how many of those; a hallway comes on top."""


def sample_cells(rng: np.random.Generator, kind: PlanKind) -> Cells | None:
    """One attempt at a layout, or nothing if a room would be too small or too long."""
    always, choices, (low, high) = _PROGRAMS[kind]
    extra = rng.permutation(len(choices))[: rng.integers(low, high + 1)]
    rooms = [*always, *(choices[i] for i in sorted(extra))]
    areas = [float(rng.uniform(*LIMITS[r].area_m2)) for r in rooms]
    order = rng.permutation(len(rooms))
    program = [(rooms[i], areas[i]) for i in order]
    layout = (_both_sides, _end_rooms, _three_columns)[rng.integers(3)]
    cells = layout(rng, program)
    if cells is None or not all(_is_proper(room, rect) for room, rect in cells):
        return None
    return cells


def _is_proper(kind: str, rect: Rect) -> bool:
    if kind == "hallway":
        return True
    sides = sorted((rect[2] - rect[0] - WALL_THICKNESS, rect[3] - rect[1] - WALL_THICKNESS))
    return sides[0] >= LIMITS[kind].min_side_m and sides[1] <= 2.1 * sides[0]


def _row(program: _Program, start: tuple[float, float], length: float, depth: float, axis: int) -> Cells:
    """Rooms side by side along an axis, sharing a length in proportion to their areas."""
    total = sum(area for _, area in program)
    cells, at = [], start[axis]
    for i, (room, area) in enumerate(program):
        last = i == len(program) - 1
        end = start[axis] + length if last else round(at + length * area / total, 2)
        other = start[1 - axis]
        low, high = ((at, other), (end, other + depth)) if axis == 0 else ((other, at), (other + depth, end))
        cells.append((room, (*low, *high)))
        at = end
    return cells


def _halves(program: _Program) -> tuple[_Program, _Program] | None:
    """Split in two of nearly equal area, or nothing if the order does not allow it."""
    areas = np.array([area for _, area in program])
    at = int(np.argmin(np.abs(np.cumsum(areas) - areas.sum() / 2))) + 1
    if at >= len(program):
        return None
    return program[:at], program[at:]


def _area(program: _Program) -> float:
    return sum(area for _, area in program)


def _both_sides(rng: np.random.Generator, program: _Program) -> Cells | None:
    """Rooms on both sides of a hallway that runs through the floor."""
    halves = _halves(program)
    if halves is None:
        return None
    hall = round(float(rng.uniform(1.45, 1.8)), 2)
    width = round(_area(program) / (2 * float(rng.uniform(3.3, 4.3))), 2)
    below, above = (round(_area(h) / width, 2) for h in halves)
    cells = _row(halves[0], (0.0, 0.0), width, below, 0)
    cells.append(("hallway", (0.0, below, width, below + hall)))
    return cells + _row(halves[1], (0.0, below + hall), width, above, 0)


def _end_rooms(rng: np.random.Generator, program: _Program) -> Cells | None:
    """One or two rooms across the end; a hallway leads from them between the others."""
    public = [p for p in program if p[0] in PUBLIC]
    end = public[:2] if public else program[:2]
    rest = [p for p in program if p not in end]
    halves = _halves(rest) if len(rest) > 1 else None
    if halves is None:
        return None
    hall = round(float(rng.uniform(1.45, 1.8)), 2)
    depth = float(rng.uniform(2.8, 4.2))
    width = round(_area(rest) / (2 * depth), 2)
    below, above = (round(_area(h) / width, 2) for h in halves)
    total = round(below + hall + above, 2)
    end_width = round(_area(end) / total, 2)
    cells = _row(end, (0.0, 0.0), total, end_width, 1)
    cells += _row(halves[0], (end_width, 0.0), width, below, 0)
    cells.append(("hallway", (end_width, below, end_width + width, below + hall)))
    return cells + _row(halves[1], (end_width, below + hall), width, above, 0)


def _three_columns(rng: np.random.Generator, program: _Program) -> Cells | None:
    """Rooms to the left and right of a living room and the hallway before it."""
    if "living_room" not in dict(program):
        return None
    middle = [p for p in program if p[0] == "living_room"]
    middle.append(("hallway", float(rng.uniform(6.0, 9.0))))
    if rng.random() < 0.5:
        middle.reverse()
    halves = _halves([p for p in program if p[0] != "living_room"])
    if halves is None:
        return None
    depth = round(float(rng.uniform(6.0, 8.5)), 2)
    cells, x = [], 0.0
    for column in (halves[0], middle, halves[1]):
        width = round(_area(column) / depth, 2)
        cells += _row(column, (x, 0.0), depth, width, 1)
        x = round(x + width, 2)
    hallway = next(rect for kind, rect in cells if kind == "hallway")
    return cells if min(hallway[2] - hallway[0], hallway[3] - hallway[1]) >= 1.5 else None


def turn_by_chance(rng: np.random.Generator, cells: Cells) -> tuple[Cells, Rect]:
    """The floor mirrored or turned by chance, its corner at the origin."""
    if rng.random() < 0.5:
        cells = [(k, (r[1], r[0], r[3], r[2])) for k, r in cells]
    width, depth = max(r[2] for _, r in cells), max(r[3] for _, r in cells)
    if rng.random() < 0.5:
        cells = [(k, (width - r[2], r[1], width - r[0], r[3])) for k, r in cells]
    if rng.random() < 0.5:
        cells = [(k, (r[0], depth - r[3], r[2], depth - r[1])) for k, r in cells]
    rounded = [(k, (round(r[0], 2), round(r[1], 2), round(r[2], 2), round(r[3], 2))) for k, r in cells]
    return rounded, (0.0, 0.0, round(width, 2), round(depth, 2))
