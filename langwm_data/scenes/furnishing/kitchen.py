"""Kitchens: a row of counters along a wall, cupboards above it, and a table where there is room."""

from collections.abc import Sequence

import numpy as np

from langwm_data.scenes.furnishing.common import (
    hang_ceiling_lamp,
    hang_pictures,
    put_at,
    put_on,
    put_plants,
    put_some_on,
)
from langwm_data.scenes.furnishing.living import put_dining_group
from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import WALL_GAP, WALLS, RoomState, Wall
from langwm_data.scenes.furniture import Model
from langwm_data.scenes.furniture.kitchen import HOTPLATES, UNIT_WIDTH

WALL_CABINET_Z = 1.42
HOOD_Z = 1.55
COUNTER_FRONT_M = 0.75
MAX_UNITS = 6


def furnish_kitchen(state: RoomState, *, has_dining: bool) -> None:
    """Counters, fridge, cupboards, and a table.

    Args:
        state: The room.
        has_dining: Whether the home has no other place for a dining table.
    """
    units = _put_counters(state)
    for unit in units:
        _hang_above(state, unit)
    if not state.of_category("fridge"):
        state.put_at_wall("fridge", prefer="corner", front_m=0.6)
    tops = [u for u in units if u.model.category in ("kitchen_cabinet", "dishwasher")]
    if tops and state.coin(0.9):
        put_on(state, tops[0], "microwave", spread=0.95)
    for top in tops[1:]:
        put_some_on(state, top, ("bottle", "bowl", "cup", "vase", "cooking_pot"), 1)
    for stove in state.of_category("stove"):
        if state.coin(0.8):
            _put_pot(state, stove)
    if has_dining or state.coin(0.4):
        put_dining_group(state, prefer_center=False, max_width=9.9 if has_dining else 1.3)
    state.put_at_wall("trash_can", prefer="corner")
    if state.coin(0.4):
        state.put_at_wall("stool")
    put_plants(state, 1)
    hang_pictures(state, 1)
    hang_ceiling_lamp(state)


def _put_counters(state: RoomState) -> list[Placement]:
    """The longest row of units that some wall takes; the fridge at one of its ends."""
    fridge = state.style.model(state.rng, "fridge")
    runs: list[tuple[float, Wall, float]] = [
        (high - low, wall, low) for wall in WALLS for low, high in _free_runs(state, wall)
    ]
    for length, wall, low in sorted(runs, reverse=True):
        has_fridge = length > fridge.size[0] + 3 * UNIT_WIDTH
        num = min(int((length - 0.02 - has_fridge * fridge.size[0]) / UNIT_WIDTH), MAX_UNITS)
        if num < 2:
            continue
        models = [state.style.model(state.rng, category) for category in _sequence(state, num)]
        if has_fridge:
            models.insert(0 if state.coin(0.5) else num, fridge)
        left_over = _shorten(models, length - 0.02)
        row = _in_a_row(state, models, wall, low + 0.01)
        units = [p for p in row if p.model is not fridge]
        if state.add(*row) or state.add(*units):
            for unit in units:
                state.keep_front_free(unit, COUNTER_FRONT_M)
            more = [state.put_at_wall(m.category, prefer="corner", front_m=0.6) for m in left_over]
            return units + [piece for piece in more if piece is not None]
    return []


def _put_pot(state: RoomState, stove: Placement) -> None:
    """A pot on a hotplate; where they are is known of our own stoves only."""
    if stove.model.mesh is None:
        put_at(state, stove, "cooking_pot", HOTPLATES[state.rng.integers(len(HOTPLATES))])
    else:
        put_on(state, stove, "cooking_pot")


def _shorten(models: list[Model], length: float) -> list[Model]:
    """Take out cupboards, last ones first, until a row is no longer than its wall; those taken out."""
    taken = []
    for i in reversed(range(len(models))):
        if sum(m.size[0] for m in models) > length + 1e-6 and models[i].category == "kitchen_cabinet":
            taken.append(models.pop(i))
    return taken


def _in_a_row(state: RoomState, models: Sequence[Model], wall: Wall, start: float) -> list[Placement]:
    row = []
    for model in models:
        row.append(state.against(model, wall, start + model.size[0] / 2, gap=WALL_GAP, z=0.0))
        start += model.size[0]
    return row


def _free_runs(state: RoomState, wall: Wall) -> list[tuple[float, float]]:
    """Stretches of a wall along which counters fit, from where to where."""
    probe = state.style.model(state.rng, "kitchen_cabinet")
    low, high = state.wall_span(wall)
    at = np.arange(low + UNIT_WIDTH / 2, high - UNIT_WIDTH / 2 + 1e-6, 0.05)
    fits = [state.fits(state.against(probe, wall, float(a), gap=WALL_GAP, z=0.0)) for a in at]
    runs: list[tuple[float, float]] = []
    for middle in (float(a) for a, ok in zip(at, fits, strict=True) if ok):
        start, end = middle - UNIT_WIDTH / 2, middle + UNIT_WIDTH / 2
        if runs and end - runs[-1][1] < 0.06:
            runs[-1] = (runs[-1][0], end)
        else:
            runs.append((start, end))
    return runs


def _sequence(state: RoomState, num: int) -> list[str]:
    """What the units of a row are: always a sink and a stove, not side by side where it can be helped."""
    kinds = ["kitchen_cabinet"] * num
    sink, stove = (0, num - 1) if num < 4 else (1, num - 2)
    if state.coin(0.5):
        sink, stove = stove, sink
    kinds[sink], kinds[stove] = "kitchen_sink", "stove"
    if num >= 4 and state.coin(0.8):
        kinds[0 if sink == 1 else num - 1] = "dishwasher"
    return kinds


def _hang_above(state: RoomState, unit: Placement) -> None:
    """A hood over the stove, cupboards over the rest."""
    is_stove = unit.model.category == "stove"
    for model in state.style.first_choices(state.rng, "range_hood" if is_stove else "wall_cabinet"):
        y = (model.size[1] - unit.model.size[1]) / 2
        z = HOOD_Z if is_stove else WALL_CABINET_Z
        if state.add(state.stand(model, unit.local(0.0, y), unit.yaw_rad, z=z)):
            return
