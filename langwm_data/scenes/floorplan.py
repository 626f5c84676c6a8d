"""The floor plan of a home: rooms that hang together by doorways, with windows and an entrance."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from langwm_data.scenes.layouts import PUBLIC, Cells, PlanKind, sample_cells, turn_by_chance
from langwm_data.scenes.openings import MIN_SHARED, place_doorways, place_windows
from langwm_data.scenes.plan import HALF_WALL, FloorPlan, shared_wall
from langwm_data.scenes.spec import RoomSpec

_MAX_TRIES = 4000


def sample_plan(rng: np.random.Generator, kind: PlanKind) -> FloorPlan:
    """A floor whose rooms all hang together by doorways.

    Rejection sampling: a layout is drawn until every room has its proper size and a doorway.
    """
    for _ in range(_MAX_TRIES):
        cells = sample_cells(rng, kind)
        if cells is None:
            continue
        cells, extent = turn_by_chance(rng, cells)
        pairs = _joined_pairs(cells)
        if pairs is None:
            continue
        rooms = _name_rooms(cells)
        openings = place_doorways(rng, rooms, pairs)
        openings += place_windows(rng, rooms, extent, has_entrance=kind in ("flat", "ground"))
        return FloorPlan(rooms=rooms, openings=tuple(openings), extent=extent)
    raise AssertionError(f"no {kind} plan found in {_MAX_TRIES} tries")


def _name_rooms(cells: Cells) -> tuple[RoomSpec, ...]:
    kinds = [kind for kind, _ in cells]
    rooms = []
    for i, (kind, (x0, y0, x1, y1)) in enumerate(cells):
        name = f"{kind}_{kinds[: i + 1].count(kind)}" if kinds.count(kind) > 1 else kind
        low = (round(x0 + HALF_WALL, 3), round(y0 + HALF_WALL, 3))
        high = (round(x1 - HALF_WALL, 3), round(y1 - HALF_WALL, 3))
        rooms.append(RoomSpec(name=name, kind=kind, rect=(*low, *high)))
    return tuple(rooms)


def _joined_pairs(cells: Cells) -> list[tuple[int, int]] | None:
    """Which cells get a doorway between them, or nothing if some room would stay closed."""
    pairs = []
    by_hallway = set()
    candidates = []
    for i, j in combinations(range(len(cells)), 2):
        shared = shared_wall(cells[i][1], cells[j][1])
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
