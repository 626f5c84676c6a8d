"""Where doorways, windows and the entrance go in the walls of a floor."""

from collections.abc import Mapping, Sequence

import numpy as np

from langwm_data.scenes.furniture.openings import (
    DOOR_HEIGHT,
    DOOR_WIDTHS,
    LINING,
    PASSAGE_WIDTHS,
    WINDOW_SIZES,
)
from langwm_data.scenes.plan import Along, Opening, cell_of, shared_wall
from langwm_data.scenes.spec import Rect, RoomSpec

CORNER_MARGIN = 0.13
"""Least distance of a doorway's hole from the end of the shared wall: room for casing and door leaf."""
MIN_SHARED = DOOR_WIDTHS[-1] + 2 * LINING + 2 * CORNER_MARGIN

SECOND_SIDE = 0.3
"""Probability that a room in a corner of the house has windows in both outer walls."""


def place_doorways(
    rng: np.random.Generator, rooms: Sequence[RoomSpec], pairs: Sequence[tuple[int, int]]
) -> list[Opening]:
    """A doorway between each pair of rooms, given by their indices; wide ones join living spaces."""
    doorways: list[Opening] = []
    for i, j in pairs:
        shared = shared_wall(cell_of(rooms[i]), cell_of(rooms[j]))
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
    along: Along,
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


def place_windows(
    rng: np.random.Generator,
    rooms: Sequence[RoomSpec],
    extent: Rect,
    *,
    has_entrance: bool,
) -> list[Opening]:
    """Windows in the outer walls, and the entrance at an end of the hallway."""
    openings: list[Opening] = []
    entrance_to = _entrance_room(rooms) if has_entrance else None
    for room in rooms:
        cell = cell_of(room)
        sides = [(s % 2, s) for s in range(4) if abs(cell[s] - extent[s]) < 1e-6]
        needs_light = True
        for axis, side in (sides[i] for i in rng.permutation(len(sides))):
            along: Along = "y" if axis == 0 else "x"
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


def _entrance(room: RoomSpec, along: Along, edge: float, span: tuple[float, float]) -> Opening:
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
    along: Along,
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
