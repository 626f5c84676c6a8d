"""Hallways, playrooms and storage rooms."""

import math

from langwm_data.scenes.furnishing.common import (
    drop,
    hang_ceiling_lamp,
    hang_pictures,
    put_on,
    put_plants,
    put_rug,
    put_some_on,
)
from langwm_data.scenes.furnishing.placement import RoomState


def furnish_hallway(state: RoomState) -> None:
    """Narrow things along the walls, and a runner."""
    console = state.put_at_wall("console_table") if state.coin(0.8) else None
    put_some_on(state, console, ("vase", "bowl", "book", "table_lamp"), 2)
    for category, probability in (("shoe_rack", 0.8), ("coat_rack", 0.7), ("bench", 0.4), ("chest", 0.2)):
        if state.coin(probability):
            state.put_at_wall(category, prefer="corner")
    if state.coin(0.6):
        state.put_at_wall("mirror", z=0.9)
    if state.coin(0.8):
        put_rug(state, state.center, 0.0 if state.size[0] > state.size[1] else math.pi / 2)
    put_plants(state, 1)
    hang_pictures(state, 2)
    for _ in range(2):
        if state.coin(0.5):
            drop(state, "shoe")
    hang_ceiling_lamp(state)


def furnish_playroom(state: RoomState) -> None:
    """Low furniture and toys on the floor."""
    for category, probability in (
        ("chest", 1.0),
        ("bookshelf", 0.9),
        ("sofa", 0.5),
        ("piano", 0.5),
        ("dresser", 0.4),
        ("pouf", 0.9),
        ("bench", 0.4),
    ):
        if state.coin(probability):
            piece = state.put_at_wall(category, prefer="any", front_m=0.3)
            if piece and category in ("dresser", "chest"):
                put_some_on(state, piece, ("toy_car", "book", "ball"), 1)
    if state.coin(0.6):
        state.put_at_wall("floor_lamp", prefer="corner")
    put_rug(state, state.center, 0.0 if state.size[0] > state.size[1] else math.pi / 2)
    for category in ("toy_car", "ball", "toy_car", "ball", "cardboard_box"):
        if state.coin(0.7):
            drop(state, category)
    hang_pictures(state, 2)
    hang_ceiling_lamp(state)


def furnish_storage_room(state: RoomState) -> None:
    """Racks, a washing machine, boxes."""
    machine = state.put_at_wall("washing_machine", prefer="corner", front_m=0.4)
    if machine and state.coin(0.8):
        put_on(state, machine, "cardboard_box", spread=0.9)
    for probability in (1.0, 0.8, 0.5):
        if state.coin(probability):
            state.put_at_wall("storage_shelf", prefer="corner", front_m=0.4)
    for category, probability in (
        ("laundry_basket", 0.8),
        ("shoe_rack", 0.5),
        ("trash_can", 0.6),
        ("stool", 0.4),
    ):
        if state.coin(probability):
            state.put_at_wall(category)
    for _ in range(3):
        if state.coin(0.7):
            drop(state, "cardboard_box")
    hang_ceiling_lamp(state)
