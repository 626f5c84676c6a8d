"""Rooms of one floor, and the openings between them.

Owns how a floor is divided: which rooms, how large, side by side or around a hallway, and where doors
and windows go. Walls built from this stand in ``walls``; furniture in ``furnishing``.

A floor is a rectangle tiled by cells. The inner extent of a room is its cell less half a wall on every
side, so two rooms are always one wall apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from langwm_data.scenes.furniture.openings import (
    DOOR_HEIGHT,
    DOOR_WIDTHS,
    LINING,
    PASSAGE_WIDTHS,
    WALL_THICKNESS,
    WINDOW_SIZES,
)
from langwm_data.scenes.spec import Rect, RoomSpec

PlanKind = Literal["flat", "ground", "upper", "attic"]

HALF_WALL = WALL_THICKNESS / 2
CORNER_MARGIN = 0.13
"""Least distance of a doorway's hole from the end of the shared wall: room for casing and door leaf."""
MIN_SHARED = DOOR_WIDTHS[-1] + 2 * LINING + 2 * CORNER_MARGIN

PUBLIC = ("hallway", "living_room", "dining_room", "kitchen")
"""Rooms that one walks through; no door joins two others."""

SECOND_SIDE = 0.3
"""Probability that a room in a corner of the house has windows in both outer walls."""

_MAX_TRIES = 4000


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


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A rectangular hole in the walls between two rooms, or between a room and outside."""

    kind: Literal["door", "passage", "entrance", "window"]
    rooms: tuple[str, ...]
    """One room for windows and entrances, else two."""
    model: str
    """Model of what fills the hole: a window or a door frame."""
    along: Literal["x", "y"]
    """The direction in which the wall runs."""
    center: tuple[float, float]
    """On the middle plane of the wall."""
    width: float
    """Of the hole."""
    clear_width: float
    """Between the linings; what is left to pass through."""
    z: tuple[float, float]
    """From sill to lintel."""

    @property
    def interval(self) -> tuple[float, float]:
        """The hole along the wall."""
        middle = self.center[0 if self.along == "x" else 1]
        return (middle - self.width / 2, middle + self.width / 2)


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """Rooms and openings of one floor."""

    rooms: tuple[RoomSpec, ...]
    openings: tuple[Opening, ...]
    extent: Rect
    """Outer edge of the cells; the middle plane of the outer walls."""


_Cells = list[tuple[str, Rect]]


def sample_plan(rng: np.random.Generator, kind: PlanKind) -> FloorPlan:
    """A floor whose rooms all hang together by doorways.

    Rejection sampling: a layout is drawn until every room has its proper size and a doorway.
    """
    for _ in range(_MAX_TRIES):
        cells = _sample_cells(rng, kind)
        if cells is None:
            continue
        cells, extent = _turn(rng, cells)
        pairs = _joined_pairs(cells)
        if pairs is None:
            continue
        rooms = _name_rooms(cells)
        openings = _place_doorways(rng, rooms, pairs)
        openings += _place_windows(rng, rooms, extent, has_entrance=kind in ("flat", "ground"))
        return FloorPlan(rooms=rooms, openings=tuple(openings), extent=extent)
    raise AssertionError(f"no {kind} plan found in {_MAX_TRIES} tries")


def cell_of(room: RoomSpec) -> Rect:
    """The room with half of its walls."""
    x0, y0, x1, y1 = room.rect
    return (x0 - HALF_WALL, y0 - HALF_WALL, x1 + HALF_WALL, y1 + HALF_WALL)


def _sample_cells(rng: np.random.Generator, kind: PlanKind) -> _Cells | None:
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


_Program = list[tuple[str, float]]


def _row(program: _Program, start: tuple[float, float], length: float, depth: float, axis: int) -> _Cells:
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


def _both_sides(rng: np.random.Generator, program: _Program) -> _Cells | None:
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


def _end_rooms(rng: np.random.Generator, program: _Program) -> _Cells | None:
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


def _three_columns(rng: np.random.Generator, program: _Program) -> _Cells | None:
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


def _turn(rng: np.random.Generator, cells: _Cells) -> tuple[_Cells, Rect]:
    """The floor mirrored or turned by chance, its corner at the origin."""
    if rng.random() < 0.5:
        cells = [(k, (r[1], r[0], r[3], r[2])) for k, r in cells]
    width, depth = max(r[2] for _, r in cells), max(r[3] for _, r in cells)
    if rng.random() < 0.5:
        cells = [(k, (width - r[2], r[1], width - r[0], r[3])) for k, r in cells]
    if rng.random() < 0.5:
        cells = [(k, (r[0], depth - r[3], r[2], depth - r[1])) for k, r in cells]
    rounded = [(k, _rect([round(v, 2) + 0.0 for v in r])) for k, r in cells]
    return rounded, (0.0, 0.0, round(width, 2), round(depth, 2))


def _rect(values: Sequence[float]) -> Rect:
    x0, y0, x1, y1 = values
    return (x0, y0, x1, y1)


def _name_rooms(cells: _Cells) -> tuple[RoomSpec, ...]:
    kinds = [kind for kind, _ in cells]
    rooms = []
    for i, (kind, (x0, y0, x1, y1)) in enumerate(cells):
        name = f"{kind}_{kinds[: i + 1].count(kind)}" if kinds.count(kind) > 1 else kind
        inner = (x0 + HALF_WALL, y0 + HALF_WALL, x1 - HALF_WALL, y1 - HALF_WALL)
        rooms.append(RoomSpec(name=name, kind=kind, rect=_rect([round(v, 3) for v in inner])))
    return tuple(rooms)


def _shared_wall(a: Rect, b: Rect) -> tuple[Literal["x", "y"], float, tuple[float, float]] | None:
    """Direction of the wall between two cells, where it stands, and from where to where it runs."""
    for axis, along in ((0, "y"), (1, "x")):
        for edge, other in ((a[axis + 2], b[axis]), (a[axis], b[axis + 2])):
            low = max(a[1 - axis], b[1 - axis]) + HALF_WALL
            high = min(a[3 - axis], b[3 - axis]) - HALF_WALL
            if abs(edge - other) < 1e-6 and high > low:
                return ("x" if along == "x" else "y", edge, (low, high))
    return None


def _joined_pairs(cells: _Cells) -> list[tuple[int, int]] | None:
    """Which cells get a doorway between them, or nothing if some room would stay closed."""
    pairs = []
    by_hallway = set()
    candidates = []
    for i, j in combinations(range(len(cells)), 2):
        shared = _shared_wall(cells[i][1], cells[j][1])
        if shared and shared[2][1] - shared[2][0] >= MIN_SHARED:
            candidates.append((i, j))
    for i, j in candidates:
        kinds = {cells[i][0], cells[j][0]}
        if "hallway" in kinds or kinds <= {"living_room", "dining_room", "kitchen"}:
            pairs.append((i, j))
            by_hallway |= {i, j}
    for i, j in candidates:
        is_public = [cells[k][0] in PUBLIC for k in (i, j)]
        if (i, j) not in pairs and any(is_public) and not {i, j} <= by_hallway:
            pairs.append((i, j))
            by_hallway |= {i, j}
    return pairs if _hangs_together(len(cells), pairs) else None


def _hangs_together(num: int, pairs: Sequence[tuple[int, int]]) -> bool:
    reached, frontier = {0}, [0]
    while frontier:
        at = frontier.pop()
        for pair in pairs:
            if at in pair:
                other = pair[0] + pair[1] - at
                if other not in reached:
                    reached.add(other)
                    frontier.append(other)
    return len(reached) == num


def _place_doorways(
    rng: np.random.Generator, rooms: Sequence[RoomSpec], pairs: Sequence[tuple[int, int]]
) -> list[Opening]:
    doorways: list[Opening] = []
    for i, j in pairs:
        shared = _shared_wall(cell_of(rooms[i]), cell_of(rooms[j]))
        assert shared is not None
        along, edge, span = shared
        names = (rooms[i].name, rooms[j].name)
        is_open = {rooms[i].kind, rooms[j].kind} <= {"living_room", "dining_room", "kitchen"}
        clear, model = _doorway_model(rng, span[1] - span[0], is_open=is_open)
        width = clear + 2 * LINING
        middle = _doorway_middle(rng, span, width, [d for d in doorways if set(d.rooms) & set(names)], along)
        doorways.append(
            Opening(
                kind="passage" if clear > DOOR_WIDTHS[-1] else "door",
                rooms=names,
                model=model,
                along=along,
                center=(middle, edge) if along == "x" else (edge, middle),
                width=round(width, 3),
                clear_width=clear,
                z=(0.0, DOOR_HEIGHT + LINING),
            )
        )
    return doorways


def _doorway_model(rng: np.random.Generator, span: float, *, is_open: bool) -> tuple[float, str]:
    """Clear width and door frame for a shared wall of length ``span``."""
    widths = (*DOOR_WIDTHS, *PASSAGE_WIDTHS)
    wide = [w for w in PASSAGE_WIDTHS if w + 2 * (LINING + CORNER_MARGIN) <= 0.7 * span]
    choices = wide if is_open and wide else DOOR_WIDTHS
    clear = choices[rng.integers(len(choices))]
    return clear, f"door_frame_{widths.index(clear) + 1:02d}"


def _doorway_middle(
    rng: np.random.Generator,
    span: tuple[float, float],
    width: float,
    others: Sequence[Opening],
    along: Literal["x", "y"],
) -> float:
    """Near an end of the shared wall, so that the rest of it stays free; far from other doorways."""
    low, high = span[0] + CORNER_MARGIN + width / 2, span[1] - CORNER_MARGIN - width / 2
    ends = [low, min(low + 0.15, high), max(high - 0.15, low), high, (low + high) / 2]
    axis = 0 if along == "x" else 1

    def score(middle: float) -> float:
        same_wall = [abs(o.center[axis] - middle) for o in others if o.along == along]
        spread = min([d for d in same_wall if d > 1e-6], default=3.0)
        return min(spread, 3.0) + float(rng.uniform(0, 1.5)) - (2.0 if middle == ends[-1] else 0.0)

    return round(max(ends, key=score), 2)


def _place_windows(
    rng: np.random.Generator,
    rooms: Sequence[RoomSpec],
    extent: Rect,
    *,
    has_entrance: bool,
) -> list[Opening]:
    openings: list[Opening] = []
    entrance_to = _entrance_room(rooms) if has_entrance else None
    for room in rooms:
        cell = cell_of(room)
        sides = [(s % 2, s) for s in range(4) if abs(cell[s] - extent[s]) < 1e-6]
        needs_light = True
        for axis, side in (sides[i] for i in rng.permutation(len(sides))):
            along: Literal["x", "y"] = "y" if axis == 0 else "x"
            span = (room.rect[1 - axis], room.rect[3 - axis])
            if room.name == entrance_to and span[1] - span[0] > MIN_SHARED:
                openings.append(_entrance(room, along, cell[side], span))
                entrance_to = None
            elif needs_light or rng.random() < SECOND_SIDE:
                openings += _windows_on(rng, room, along, cell[side], span)
                needs_light = False
    return openings


def _entrance_room(rooms: Sequence[RoomSpec]) -> str:
    return next(r.name for r in rooms if r.kind == "hallway")


def _entrance(room: RoomSpec, along: Literal["x", "y"], edge: float, span: tuple[float, float]) -> Opening:
    clear = DOOR_WIDTHS[-1]
    middle = round(sum(span) / 2, 2)
    return Opening(
        kind="entrance",
        rooms=(room.name,),
        model=f"door_frame_{DOOR_WIDTHS.index(clear) + 1:02d}",
        along=along,
        center=(middle, edge) if along == "x" else (edge, middle),
        width=round(clear + 2 * LINING, 3),
        clear_width=clear,
        z=(0.0, DOOR_HEIGHT + LINING),
    )


_WINDOW_CHOICES: Mapping[str, tuple[tuple[int, ...], float]] = {
    "living_room": ((5, 6), 0.35),
    "dining_room": ((4, 5), 0.8),
    "bedroom": ((3, 4), 0.85),
    "playroom": ((3, 4), 0.85),
    "study": ((3, 4), 0.85),
    "kitchen": ((2, 3), 1.05),
    "bathroom": ((1, 2), 1.3),
    "storage_room": ((1,), 1.4),
    "hallway": ((2,), 0.9),
}
"""Sizes (numbers of ``WINDOW_SIZES`` from 1) that a kind of room has, and the height of the sill."""


def _windows_on(
    rng: np.random.Generator,
    room: RoomSpec,
    along: Literal["x", "y"],
    edge: float,
    span: tuple[float, float],
) -> list[Opening]:
    sizes, sill = _WINDOW_CHOICES[room.kind]
    number = sizes[rng.integers(len(sizes))]
    width, height = WINDOW_SIZES[number - 1]
    top = 2.1
    sill = sill if sill + height <= 2.3 else top - height
    length = span[1] - span[0]
    num = min(2 if length > 2.2 * width + 2.2 else 1, int(length // (width + 0.5)))
    variant = number + len(WINDOW_SIZES) * int(rng.integers(2))
    openings = []
    for i in range(num):
        middle = round(span[0] + length * (i + 0.5) / num + float(rng.uniform(-0.15, 0.15)), 2)
        openings.append(
            Opening(
                kind="window",
                rooms=(room.name,),
                model=f"window_{variant:02d}",
                along=along,
                center=(middle, edge) if along == "x" else (edge, middle),
                width=width,
                clear_width=width,
                z=(round(sill, 3), round(sill + height, 3)),
            )
        )
    return openings
