"""What belongs to the openings of a room: window, curtains, radiator, door frame and door leaf.

Also marks what furniture must keep out of: the way through doorways, and the light of windows.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import WALL_GAP, RoomState, Wall, Zone
from langwm_data.scenes.furniture import build_model, model_names
from langwm_data.scenes.furniture.decor import CURTAIN_DROPS
from langwm_data.scenes.furniture.openings import (
    CASING,
    DOOR_HEIGHT,
    DOOR_THICKNESS,
    DOOR_WIDTHS,
    WALL_THICKNESS,
)
from langwm_data.scenes.plan import FloorPlan, Opening, cell_of
from langwm_data.scenes.spec import Rect

DOOR_ZONE = 0.7
"""How deep the space before a doorway is kept free, metres."""
ZONE_MARGIN = 0.05
"""How much wider than the hole that space is, on either side."""
WINDOW_ZONE = 0.3
LONG_CURTAIN_KINDS = ("living_room", "bedroom", "dining_room")
_INWARD = {"south": (0, 1), "east": (-1, 0), "north": (0, -1), "west": (1, 0)}


def fill_openings(plan: FloorPlan, rooms: Mapping[str, RoomState]) -> None:
    """Put frames, windows and doors into all openings, and mark the zones they need."""
    for opening in plan.openings:
        for name in opening.rooms:
            _mark_zone(rooms[name], opening)
        _add_unchecked(rooms[opening.rooms[0]], opening)
    for opening in plan.openings:
        if opening.kind == "entrance":
            _close_entrance(rooms[opening.rooms[0]], opening)
        elif opening.kind == "door":
            _hang_open_door(opening, [rooms[name] for name in opening.rooms])


def dress_windows(plan: FloorPlan, state: RoomState) -> None:
    """Curtains beside and radiators below the windows of one room."""
    for opening in plan.openings:
        if opening.kind != "window" or opening.rooms != (state.room.name,):
            continue
        wall = wall_of(opening, state)
        middle = opening.center[0 if opening.along == "x" else 1]
        if state.room.kind not in ("bathroom", "storage_room", "kitchen") and state.coin(0.8):
            _hang_curtains(state, opening, wall, middle)
        if opening.z[0] > 0.75 and state.room.kind != "kitchen" and state.coin(0.6):
            models = state.style.first_choices(state.rng, "radiator")
            any(state.add(state.against(model, wall, middle, gap=WALL_GAP, z=0.0)) for model in models)


def wall_of(opening: Opening, state: RoomState) -> Wall:
    """The wall of a room in which an opening lies."""
    cell = cell_of(state.room)
    if opening.along == "x":
        return "south" if abs(opening.center[1] - cell[1]) < 1e-6 else "north"
    return "west" if abs(opening.center[0] - cell[0]) < 1e-6 else "east"


def _mark_zone(state: RoomState, opening: Opening) -> None:
    wall = wall_of(opening, state)
    if opening.kind == "window":
        rect = _before(state, wall, opening.interval, WINDOW_ZONE)
        state.zones.append(Zone(kind="window", rect=rect, z=opening.z))
        return
    state.zones.append(_door_zone(state, opening))
    n = _INWARD[wall]
    reach = WALL_THICKNESS / 2 + 0.45
    state.entries.append((opening.center[0] + n[0] * reach, opening.center[1] + n[1] * reach))


def _before(state: RoomState, wall: Wall, interval: tuple[float, float], depth: float) -> Rect:
    """The strip of floor inside a room along part of a wall."""
    low, high = interval
    x0, y0, x1, y1 = state.rect
    return {
        "south": (low, y0, high, y0 + depth),
        "north": (low, y1 - depth, high, y1),
        "west": (x0, low, x0 + depth, high),
        "east": (x1 - depth, low, x1, high),
    }[wall]


def _wall_yaw(opening: Opening, state: RoomState) -> float:
    return {"south": 0.0, "east": math.pi / 2, "north": math.pi, "west": -math.pi / 2}[
        wall_of(opening, state)
    ]


def _add_unchecked(state: RoomState, opening: Opening) -> None:
    """What fills a hole in the wall lies outside the room's rectangle; the hole was cut for it."""
    model = build_model(opening.model)
    # A window's board stands 1 cm further in than its frame reaches out.
    shift = model.size[1] / 2 - 0.045 if opening.kind == "window" else 0.0
    n = _INWARD[wall_of(opening, state)]
    xy = (opening.center[0] + n[0] * shift, opening.center[1] + n[1] * shift)
    state.placements.append(state.stand(model, xy, _wall_yaw(opening, state), z=opening.z[0]))


def _door_model(state: RoomState, opening: Opening) -> str:
    """A door leaf that fits a doorway, of the building's usual look."""
    number = DOOR_WIDTHS.index(opening.clear_width)
    names = [n for i, n in enumerate(model_names("door")) if i % len(DOOR_WIDTHS) == number]
    is_second = model_names("door")[0] in state.style.variants["door"]
    return names[1 if is_second else 0]


def _close_entrance(state: RoomState, opening: Opening) -> None:
    model = build_model(_door_model(state, opening))
    state.placements.append(state.stand(model, opening.center, _wall_yaw(opening, state), z=0.008))


def _hang_open_door(opening: Opening, states: list[RoomState]) -> None:
    """Stand the leaf open in one of the two rooms, where it is least in the way.

    A leaf stands square to its wall, best along a side wall close by, or is folded back flat.
    """
    options: list[tuple[float, int, RoomState, Placement]] = []
    for state in states:
        dislike = 1.5 if state.room.kind == "hallway" else 0.0
        for hinge in (-1, 1):
            for is_folded in (False, True):
                leaf = _leaf(state, opening, hinge, is_folded=is_folded)
                cost = 1.0 if is_folded else min(3.0, 4.0 * _gap_to_side_wall(state, leaf, opening))
                options.append((cost + dislike, len(options), state, leaf))
    for _, _, state, leaf in sorted(options, key=lambda o: o[:2]):
        zones = state.zones
        own = _door_zone(state, opening)
        # Beside its own doorway a leaf may use the margin that furniture keeps free.
        state.zones = [z for z in zones if z != own] + [replace(own, rect=_narrowed(own.rect, opening))]
        is_placed = state.add(leaf)
        state.zones = zones
        if is_placed:
            return


def _door_zone(state: RoomState, opening: Opening) -> Zone:
    low, high = opening.interval
    rect = _before(state, wall_of(opening, state), (low - ZONE_MARGIN, high + ZONE_MARGIN), DOOR_ZONE)
    return Zone(kind="doorway", rect=rect, z=(0.0, DOOR_HEIGHT))


def _narrowed(rect: Rect, opening: Opening) -> Rect:
    """A strip before a doorway, only as wide as what is left between the linings."""
    trim = (opening.width - opening.clear_width) / 2 + ZONE_MARGIN + 0.001
    x0, y0, x1, y1 = rect
    return (x0 + trim, y0, x1 - trim, y1) if opening.along == "x" else (x0, y0 + trim, x1, y1 - trim)


def _leaf(state: RoomState, opening: Opening, hinge: int, *, is_folded: bool) -> Placement:
    """The leaf hinged at the lower (-1) or upper (+1) end of a doorway, open into a room."""
    model = build_model(_door_model(state, opening))
    wall = wall_of(opening, state)
    axis = 0 if opening.along == "x" else 1
    jamb = opening.center[axis] + hinge * opening.clear_width / 2
    n = _INWARD[wall]
    half_wall, half_leaf = WALL_THICKNESS / 2 + CASING, model.size[0] / 2
    if is_folded:
        along, inward = jamb + hinge * (half_leaf + 0.01), half_wall + model.size[1] / 2 + 0.01
        yaw = 0.0 if opening.along == "x" else math.pi / 2
        yaw += math.pi if hinge < 0 else 0.0
    else:
        along, inward = jamb + hinge * (DOOR_THICKNESS / 2 + 0.02), half_wall + half_leaf + 0.005
        yaw = math.atan2(n[1], n[0])
    edge = opening.center[1 - axis] + n[1 - axis] * inward
    return state.stand(model, (along, edge) if axis == 0 else (edge, along), yaw, z=0.008)


def _gap_to_side_wall(state: RoomState, leaf: Placement, opening: Opening) -> float:
    axis = 0 if opening.along == "x" else 1
    at = leaf.position[axis]
    return min(at - state.rect[axis], state.rect[axis + 2] - at)


def _hang_curtains(state: RoomState, opening: Opening, wall: Wall, middle: float) -> None:
    wants_long = state.room.kind in LONG_CURTAIN_KINDS and state.coin(0.8)
    drop = CURTAIN_DROPS[1 if wants_long else 0]
    names = [n for n in state.style.variants["curtain"] if abs(build_model(n).size[2] - drop) < 0.01]
    if not names:
        names = [n for n in model_names("curtain") if abs(build_model(n).size[2] - drop) < 0.01]
    model = build_model(names[state.rng.integers(len(names))])
    z = opening.z[1] + 0.12 - drop if not wants_long else 0.02
    offset = opening.width / 2 + model.size[0] / 2 - 0.06
    for side in (-1, 1):
        hung = state.against(model, wall, middle + side * offset, gap=WALL_GAP, z=max(z, 0.02))
        state.add(hung, zones=("doorway",))
