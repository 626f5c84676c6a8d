"""Bedrooms, bathrooms, studies."""

import math

from langwm_data.scenes.furnishing.common import (
    drop,
    hang_ceiling_lamp,
    hang_over,
    hang_pictures,
    put_on,
    put_plants,
    put_rug,
    put_some_on,
)
from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import RoomState


def furnish_bedroom(state: RoomState) -> None:
    """A bed with its head at a wall, nightstands, and places for clothes."""
    bed = _put_bed(state)
    state.put_at_wall("wardrobe", prefer="corner", front_m=0.5)
    if state.coin(0.8):
        dresser = state.put_at_wall("dresser", prefer="center", front_m=0.4)
        put_some_on(state, dresser, ("vase", "book", "table_lamp", "bottle"), 2)
        hang_over(state, dresser, "mirror", 1.0)
    if state.coin(0.35):
        put_work_place(state)
    if bed:
        _put_at_foot_end(state, bed)
        hang_over(state, bed, "picture", 1.3)
    for category, probability in (
        ("armchair", 0.3),
        ("pouf", 0.25),
        ("bookshelf", 0.3),
        ("laundry_basket", 0.35),
    ):
        if state.coin(probability):
            state.put_at_wall(category, prefer="corner", front_m=0.2)
    put_plants(state, 1)
    hang_pictures(state, 1)
    if state.coin(0.4):
        drop(state, "shoe")
    hang_ceiling_lamp(state)


def _put_bed(state: RoomState) -> Placement | None:
    """The widest bed that goes in with a nightstand on each side, or one, or none; any of a catalogue."""
    models = list(state.style.models(state.rng, "bed"))
    beds = sorted((m for m in models if m.mesh is None), key=lambda m: -m.size[0])
    if state.coin(0.3):
        beds.reverse()
    stand = state.style.model(state.rng, "nightstand")
    for model in [m for m in models if m.mesh] + beds:
        for sides in ((-1, 1), (-1,), (1,), ()):
            for bed in state.wall_placements(model, prefer="center" if len(sides) == 2 else "corner"):
                stands = [
                    state.stand(
                        stand,
                        bed.local(
                            side * (model.size[0] + stand.size[0] + 0.06) / 2,
                            (stand.size[1] - model.size[1]) / 2,
                        ),
                        bed.yaw_rad,
                    )
                    for side in sides
                ]
                if state.add(bed, *stands):
                    for i, piece in enumerate(stands):
                        put_on(
                            state, piece, "table_lamp" if i == 0 or state.coin(0.6) else "book", spread=0.9
                        )
                    return bed
    return None


def _put_at_foot_end(state: RoomState, bed: Placement) -> None:
    if state.coin(0.35):
        for model in state.style.first_choices(state.rng, "chest" if state.coin(0.5) else "bench"):
            at = bed.local(0.0, (bed.model.size[1] + model.size[1]) / 2 + 0.05)
            if state.add(state.stand(model, at, bed.yaw_rad)):
                break
    if state.coin(0.7):
        for side in (-1, 1):
            at = bed.local(side * (bed.model.size[0] / 2 + 0.42), 0.35)
            if put_rug(state, at, bed.yaw_rad + math.pi / 2, max_width=1.3):
                break


def furnish_bathroom(state: RoomState) -> None:
    """Tub or shower, basin with a mirror, toilet."""
    if min(state.size) > 2.3 or state.coin(0.5):
        first, second = "bathtub", "shower"
    else:
        first, second = "shower", "bathtub"
    if not state.put_at_wall(first, prefer="corner", front_m=0.35):
        state.put_at_wall(second, prefer="corner", front_m=0.35)
    state.put_at_wall("toilet", prefer="any", front_m=0.45)
    basin = state.put_at_wall("washbasin", prefer="center", front_m=0.45)
    hang_over(state, basin, "mirror", 1.1)
    if state.coin(0.6):
        machine = state.put_at_wall("washing_machine", prefer="corner", front_m=0.4)
        put_some_on(state, machine, ("bottle", "cardboard_box"), 1)
    if state.coin(0.8):
        state.put_at_wall("towel_rail", z=0.55)
    for category, probability in (("laundry_basket", 0.7), ("trash_can", 0.5), ("stool", 0.3)):
        if state.coin(probability):
            state.put_at_wall(category, prefer="corner")
    if basin and state.coin(0.7):
        put_rug(state, basin.local(0.0, basin.model.size[1] / 2 + 0.45), basin.yaw_rad, max_width=0.9)
    hang_ceiling_lamp(state)


def furnish_study(state: RoomState) -> None:
    """A desk with a chair and a screen, shelves of books."""
    put_work_place(state)
    for probability in (1.0, 0.8, 0.5):
        if state.coin(probability):
            state.put_at_wall("bookshelf", prefer="corner", front_m=0.3)
    for category, probability in (("armchair", 0.5), ("chest", 0.4), ("piano", 0.25), ("storage_shelf", 0.3)):
        if state.coin(probability):
            state.put_at_wall(category, prefer="corner", front_m=0.2)
    if state.coin(0.6):
        state.put_at_wall("floor_lamp", prefer="corner")
    if state.coin(0.7):
        state.put_at_wall("trash_can")
    put_rug(state, state.center, 0.0 if state.size[0] > state.size[1] else math.pi / 2)
    put_plants(state, 2)
    hang_pictures(state, 2)
    if state.coin(0.5):
        drop(state, "cardboard_box")
    hang_ceiling_lamp(state)


def put_work_place(state: RoomState) -> Placement | None:
    """A desk with a screen and a chair before it."""
    desk = state.put_at_wall("desk", prefer="center", front_m=0.6)
    if desk is None:
        return None
    d = desk.model.size[1]
    screen = state.style.model(state.rng, "monitor")
    state.add(state.stand(screen, desk.local(0.0, -d / 2 + 0.14), desk.yaw_rad, on=desk), zones=())
    keys = state.style.model(state.rng, "keyboard")
    state.add(state.stand(keys, desk.local(0.0, d / 2 - 0.16), desk.yaw_rad, on=desk), zones=())
    category = "office_chair" if state.coin(0.75) else "chair"
    for model in state.style.models(state.rng, category):
        for x in (0.0, 0.12, -0.12):
            y = d / 2 + model.size[1] / 2 - float(state.rng.uniform(0.0, 0.15))
            chair = state.stand(model, desk.local(x, y), round(desk.yaw_rad + math.pi, 4))
            if state.add(chair, zones=("doorway",)):
                put_some_on(state, desk, ("book", "cup", "table_lamp"), 2)
                return desk
    return desk
