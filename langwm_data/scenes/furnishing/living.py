"""Living rooms and dining rooms."""

import math

import numpy as np

from langwm_data.scenes.furnishing.common import (
    hang_ceiling_lamp,
    hang_over,
    hang_pictures,
    put_on,
    put_plants,
    put_rug,
    put_some_on,
    rug_height,
)
from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import RoomState
from langwm_data.scenes.furniture import Model

PUSHED_IN_M = 0.25
"""More than any chair is pushed under a table."""
VIEWING_M = (3.0, 2.6, 2.3, 2.0, 1.8)
"""Distances between the fronts of a sofa and of a television, tried in turn."""


def furnish_living_room(state: RoomState, *, has_dining: bool) -> None:
    """A sofa that faces the television, a table between them, and what stands around.

    Args:
        state: The room.
        has_dining: Whether a dining table belongs here too.
    """
    pair = _put_sofa_and_tv(state)
    if pair:
        _put_between(state, *pair)
        _put_beside_sofa(state, pair[1])
        hang_over(state, pair[1], "picture", 1.2)
    if has_dining:
        put_dining_group(state, prefer_center=False)
    for category, probability in (("bookshelf", 0.9), ("sideboard", 0.5), ("piano", 0.3), ("bookshelf", 0.4)):
        if state.coin(probability):
            piece = state.put_at_wall(category, prefer="corner", front_m=0.3)
            if category == "sideboard":
                put_some_on(state, piece, ("vase", "bowl", "table_lamp"), 2)
    if not state.of_category("floor_lamp") and state.coin(0.7):
        state.put_at_wall("floor_lamp", prefer="corner")
    put_plants(state, 2)
    hang_pictures(state, 2)
    hang_ceiling_lamp(state)


def furnish_dining_room(state: RoomState) -> None:
    """A table with chairs in the middle, a sideboard at a wall."""
    table = put_dining_group(state, prefer_center=True)
    piece = state.put_at_wall("sideboard", prefer="center", front_m=0.3)
    put_some_on(state, piece, ("vase", "bowl", "bottle", "table_lamp"), 2)
    hang_over(state, piece, "picture", 1.2)
    if state.coin(0.4):
        state.put_at_wall("dresser", prefer="corner", front_m=0.3)
    put_plants(state, 2)
    hang_pictures(state, 1)
    hang_ceiling_lamp(state, table.position[:2] if table else None)


def put_dining_group(state: RoomState, *, prefer_center: bool, max_width: float = 9.9) -> Placement | None:
    """A table somewhere with room around it, chairs tucked under it, and things on it."""
    table = _put_table(state, prefer_center=prefer_center, max_width=max_width)
    if table is None:
        return None
    chair = state.style.model(state.rng, "chair")
    for xy, yaw in _seats(state, table, chair):
        pushed_in = state.stand(chair, xy, yaw)
        if not state.add(pushed_in, zones=("doorway",)) and chair.mesh:
            # The arms of some do not go under the table.
            state.add(state.stand(chair, pushed_in.local(0.0, -PUSHED_IN_M), yaw), zones=("doorway",))
    put_some_on(state, table, ("vase", "bowl", "cup", "bottle", "cup"), 3)
    return table


def _put_table(state: RoomState, *, prefer_center: bool, max_width: float) -> Placement | None:
    x0, y0, x1, y1 = state.rect
    spots = [(x, y) for x in np.arange(x0 + 0.8, x1 - 0.7, 0.15) for y in np.arange(y0 + 0.8, y1 - 0.7, 0.15)]
    for model in state.style.models(state.rng, "dining_table"):
        if model.size[0] > max_width:
            continue
        order = state.rng.permutation(len(spots))
        if prefer_center:
            order = sorted(order, key=lambda i: math.dist(spots[i], state.center))
        for i in order[:150]:
            yaw = math.pi / 2 if state.size[1] > state.size[0] else 0.0
            table = state.stand(model, (float(spots[i][0]), float(spots[i][1])), yaw)
            if _has_room_for_chairs(state, table) and state.add(table):
                return table
    return None


def _has_room_for_chairs(state: RoomState, table: Placement) -> bool:
    """Whether chairs fit between the table and what stands around it."""
    w, d, h = table.model.size
    around = Model(name="space", category="space", size=(w + 0.5, d + 1.1, h), parts=(), slots=())
    return state.fits(state.stand(around, table.position[:2], table.yaw_rad), zones=("doorway",))


def _seats(state: RoomState, table: Placement, chair: Model) -> list[tuple[tuple[float, float], float]]:
    """Where chairs stand, pushed in more or less, and where they face."""
    w, d, _ = table.model.size
    seats = []
    if table.model.is_round:
        start = float(state.rng.choice([0.0, math.pi / 4]))
        for i in range(4):
            turn = start + i * math.pi / 2
            reach = w / 2 + chair.size[1] / 2 - float(state.rng.uniform(0.05, 0.15))
            seats.append((table.local(reach * math.sin(turn), -reach * math.cos(turn)), table.yaw_rad + turn))
        return seats
    num = 2 if w < 1.7 else 3
    for side in (-1, 1):
        for i in range(num):
            x = (i - (num - 1) / 2) * (w - 0.3) / num
            y = side * (d / 2 + chair.size[1] / 2 - float(state.rng.uniform(0.1, 0.24)))
            seats.append((table.local(x, y), table.yaw_rad + (math.pi if side > 0 else 0.0)))
    return seats


def _put_sofa_and_tv(state: RoomState) -> tuple[Placement, Placement] | None:
    """A television at a wall and a sofa opposite, at that wall's other side or in the room."""
    for stand_model in state.style.models(state.rng, "tv_stand"):
        tvs = [m for m in state.style.models(state.rng, "tv") if m.size[0] < stand_model.size[0]]
        for sofa_model in state.style.models(state.rng, "sofa"):
            for stand in state.wall_placements(stand_model, prefer="center"):
                if not tvs or not state.fits(stand):
                    continue
                tv = state.stand(tvs[0], stand.local(0.0, -0.02), stand.yaw_rad, on=stand)
                for sofa in _sofas_before(state, stand, sofa_model):
                    if state.add(stand, tv, sofa):
                        return stand, sofa
    return None


def _sofas_before(state: RoomState, stand: Placement, model: Model) -> list[Placement]:
    is_along_x = abs(math.sin(stand.yaw_rad)) > 0.5
    free = state.size[0 if is_along_x else 1] - stand.model.size[1] - model.size[1] - 0.02
    distances = [d for d in VIEWING_M if d < free - 0.55]
    if 1.7 < free < 3.4:
        distances.insert(0, free)
    front = stand.model.size[1] / 2 + model.size[1] / 2
    return [
        state.stand(model, stand.local(0.0, front + distance), stand.yaw_rad + math.pi)
        for distance in distances
    ]


def _put_between(state: RoomState, stand: Placement, sofa: Placement) -> None:
    """Rug and coffee table before the sofa; an armchair or a pouf beside them."""
    tables = list(state.style.first_choices(state.rng, "coffee_table"))
    rug = (
        put_rug(state, sofa.local(0.0, sofa.model.size[1] / 2 + 0.62), sofa.yaw_rad)
        if state.coin(0.8)
        else None
    )
    for model in tables:
        middle = sofa.local(0.0, sofa.model.size[1] / 2 + 0.4 + model.size[1] / 2)
        table = state.stand(model, middle, sofa.yaw_rad, z=rug_height(rug))
        if rug and not _is_on(table, rug):
            state.placements.remove(rug)
            rug = None
            table = state.stand(model, middle, sofa.yaw_rad)
        if state.add(table):
            put_some_on(state, table, ("book", "cup", "bowl", "vase"), 2)
            break
    for side in (-1, 1) if state.coin(0.5) else (1, -1):
        if state.coin(0.75):
            _put_side_seat(state, sofa, side, "armchair" if state.coin(0.8) else "pouf")


def _is_on(piece: Placement, rug: Placement) -> bool:
    (x0, y0, _), (x1, y1, _) = piece.bounds
    a0, b0, a1, b1 = rug.footprint
    return a0 <= x0 and b0 <= y0 and x1 <= a1 and y1 <= b1 and len(rug.model.parts) > 1


def _put_side_seat(state: RoomState, sofa: Placement, side: int, category: str) -> None:
    places = [(out, ahead) for out in (0.35, 0.55, 0.15) for ahead in (0.75, 1.0, 0.5)]
    for model in state.style.first_choices(state.rng, category):
        for out, ahead in places:
            at = sofa.local(
                side * (sofa.model.size[0] / 2 + model.size[1] / 2 + out - 0.3),
                sofa.model.size[1] / 2 + ahead,
            )
            turn = side * (math.pi / 2 + float(state.rng.uniform(-0.15, 0.35)))
            if state.add(state.stand(model, at, round(sofa.yaw_rad + turn, 4))):
                return


def _put_beside_sofa(state: RoomState, sofa: Placement) -> None:
    """A small table with a lamp, or a floor lamp, at either end."""
    w, d, _ = sofa.model.size
    sides = [-1, 1] if state.coin(0.5) else [1, -1]
    for side, category in zip(sides, ("side_table", "floor_lamp"), strict=True):
        if not state.coin(0.75):
            continue
        for model in state.style.first_choices(state.rng, category):
            at = sofa.local(side * (w / 2 + model.size[0] / 2 + 0.04), -d / 2 + model.size[1] / 2)
            piece = state.stand(model, at, sofa.yaw_rad)
            if state.add(piece):
                if category == "side_table":
                    put_on(state, piece, "table_lamp", spread=0.95)
                    put_some_on(state, piece, ("cup", "book"), 1)
                break
