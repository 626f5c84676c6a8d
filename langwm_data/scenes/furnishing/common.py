"""What every room gets: lamps, pictures, plants and the small things that lie about."""

import math
from collections.abc import Sequence

from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import RoomState
from langwm_data.scenes.furniture import Model
from langwm_data.scenes.geometry import rects_overlap
from langwm_data.scenes.taxonomy import CATEGORIES

LOOSE_DROP = 0.004
"""Loose things start this high above what they rest on, metres, and physics lets them settle."""


def put_on(state: RoomState, support: Placement, category: str, *, spread: float = 0.7) -> bool:
    """Lay something small on top of a piece; ``spread`` is how far out on its surface."""
    is_loose = CATEGORIES[category].is_loose
    top = support.model.top
    if top is None:
        return False
    x0, y0, x1, y1 = top.rect
    for model in state.style.models(state.rng, category):
        width, depth = (x1 - x0) * spread, (y1 - y0) * spread
        reach = max(model.size[:2]) if is_loose else 0.0
        room_x = (width - (reach or model.size[0])) / 2
        room_y = (depth - (reach or model.size[1])) / 2
        if min(room_x, room_y) < -0.01:
            continue
        for _ in range(8):
            x, y = state.rng.uniform(-1, 1, size=2) * (max(room_x, 0.0), max(room_y, 0.0))
            turn = float(state.rng.uniform(-math.pi, math.pi)) if is_loose else 0.0
            at = (float(x) + (x0 + x1) / 2, float(y) + (y0 + y1) / 2)
            if state.add(_small(state, model, support, at, turn), zones=()):
                return True
    return False


def put_at(state: RoomState, support: Placement, category: str, at: tuple[float, float]) -> bool:
    """Lay something small on a piece at a point of the piece's own frame."""
    model = state.style.model(state.rng, category)
    return state.add(_small(state, model, support, at, 0.0), zones=())


def _small(
    state: RoomState, model: Model, support: Placement, at: tuple[float, float], turn: float
) -> Placement:
    is_loose = CATEGORIES[model.category].is_loose
    x, y = support.local(*at)
    return Placement(
        model=model,
        room=state.room.name,
        position=(round(x, 4), round(y, 4), round(support.surface + LOOSE_DROP * is_loose, 4)),
        yaw_rad=round(support.yaw_rad + turn, 4),
        is_fixed=not is_loose,
        support=support,
    )


def put_some_on(state: RoomState, support: Placement | None, categories: Sequence[str], num: int) -> None:
    """Up to ``num`` small things of some categories on a piece."""
    if support is None:
        return
    for category in state.shuffled(categories)[:num]:
        if state.coin(0.7):
            put_on(state, support, category)


def drop(state: RoomState, category: str, *, tries: int = 20) -> bool:
    """Leave something loose on the floor, off the rugs."""
    model = state.style.model(state.rng, category)
    reach = math.hypot(*model.size[:2]) / 2 + 0.03
    x0, y0, x1, y1 = state.rect
    for _ in range(tries):
        x, y = state.rng.uniform((x0 + reach, y0 + reach), (x1 - reach, y1 - reach))
        new = Placement(
            model=model,
            room=state.room.name,
            position=(round(float(x), 4), round(float(y), 4), LOOSE_DROP),
            yaw_rad=round(float(state.rng.uniform(-math.pi, math.pi)), 4),
            is_fixed=False,
        )
        if not any(rects_overlap(new.footprint, r.footprint) for r in state.of_category("rug")) and state.add(
            new
        ):
            return True
    return False


def hang_ceiling_lamp(state: RoomState, xy: tuple[float, float] | None = None) -> None:
    """A lamp at the ceiling, in the middle of the room unless told otherwise."""
    for model in state.style.first_choices(state.rng, "ceiling_lamp"):
        if state.add(state.stand(model, xy or state.center, z=state.height_m - model.size[2]), zones=()):
            return


def hang_pictures(state: RoomState, num: int) -> None:
    """Pictures at eye height."""
    for _ in range(num):
        if state.coin(0.8):
            state.put_at_wall("picture", prefer="center", z=round(float(state.rng.uniform(1.15, 1.35)), 2))


def hang_over(state: RoomState, piece: Placement | None, category: str, z: float) -> bool:
    """A picture or mirror on the wall behind a piece."""
    if piece is None or not state.is_at_wall(piece):
        return False
    for model in state.style.models(state.rng, category):
        back = -piece.model.size[1] / 2 + model.size[1] / 2
        new = state.stand(model, piece.local(0.0, back), piece.yaw_rad, z=max(z, piece.top + 0.1))
        if state.add(new):
            return True
    return False


def put_rug(
    state: RoomState, xy: tuple[float, float], yaw_rad: float, *, max_width: float = 9.9
) -> Placement | None:
    """A rug centred at a point, the largest of the building's that lies flat there."""
    models = [m for m in state.style.models(state.rng, "rug") if m.size[0] <= max_width]
    for model in sorted(models, key=lambda m: -m.size[0] * m.size[1]):
        new = state.stand(model, xy, yaw_rad)
        # A door could not pass over a rug; before a window or a wardrobe it may lie.
        if state.add(new, zones=("doorway",)):
            return new
    return None


def rug_height(rug: Placement | None) -> float:
    """Where a piece on this rug stands."""
    return rug.top if rug else 0.0


def put_plants(state: RoomState, num: int) -> None:
    """Potted plants in corners."""
    for _ in range(num):
        if state.coin(0.6):
            state.put_at_wall("potted_plant", prefer="corner")
