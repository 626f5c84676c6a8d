"""Recipes for windows, doors and their frames, which fill holes in walls.

A model's own y runs through the wall; +y is the side of the room.
"""

from langwm_data.scenes.furniture.model import Builder

WALL_THICKNESS = 0.1
LINING = 0.045
"""Thickness of the boards that line a doorway."""
CASING = 0.012
"""How far a door frame stands out of the wall on either side."""
DOOR_THICKNESS = 0.04
DOOR_HEIGHT = 2.03
"""Clear height of a doorway."""
DOOR_WIDTHS = (0.92, 0.96, 1.0)
"""Clear widths of doorways with a door leaf, metres."""
PASSAGE_WIDTHS = (1.4, 1.7, 2.0)
"""Clear widths of open passages."""
WINDOW_SIZES = ((0.6, 0.6), (0.8, 1.0), (1.0, 1.3), (1.2, 1.3), (1.4, 1.3), (1.5, 1.75))
"""Width and height of the hole, metres; models n and n + 6 share one."""


def window(b: Builder, index: int) -> None:
    """A frame with one or two bars, and a bright pane with the garden below and the sky above."""
    w, h = WINDOW_SIZES[(index - 1) % len(WINDOW_SIZES)]
    frame, sky = b.slot("frame", ("paint", "plastic", "wood")), b.slot("sky", ("porcelain", "plaster"))
    garden = b.slot("garden", ("moss",))
    bar, y = 0.06, 0.0
    for x in (-1, 1):
        b.box(frame, (bar, 0.06, h), (x * (w - bar) / 2, y, 0))
    for z in (0.0, h - bar):
        b.box(frame, (w - 2 * bar, 0.06, bar), (0, y, z))
    if w > 0.9:
        b.box(frame, (0.05, 0.05, h - 2 * bar), (0, y, bar))
    if b.coin(0.4):
        for x in (-1, 1) if w > 0.9 else (0,):
            bar_w = (w - 2 * bar - 0.05) / 2 if w > 0.9 else w - 2 * bar
            b.box(frame, (bar_w, 0.03, 0.035), (x * (bar_w + 0.05) / 2, y, 0.62 * h))
    horizon = b.uniform(0.12, 0.3) * h
    b.box(garden, (w - 0.02, 0.01, horizon), (0, -0.04, 0.01))
    b.box(sky, (w - 0.02, 0.01, h - 0.02 - horizon), (0, -0.04, 0.01 + horizon))
    b.box(frame, (w, 0.02, 0.02), (0, 0.04, 0.0))


def door(b: Builder, index: int) -> None:
    """A door leaf with panels and handles; its width is that of a doorway, less a little play."""
    w, h = DOOR_WIDTHS[(index - 1) % len(DOOR_WIDTHS)] - 0.01, DOOR_HEIGHT - 0.02
    leaf, metal = b.slot("leaf", ("wood", "paint", "planks")), b.slot("handle", ("metal",))
    b.box(leaf, (w, DOOR_THICKNESS - 0.012, h), (0, 0, 0))
    raised = b.slot("panels", ("wood", "paint")) if b.coin(0.3) else leaf
    rows = ((0.12, 0.75), (1.0, 0.85)) if b.coin() else ((0.12, 0.5), (0.72, 0.5), (1.32, 0.55))
    for y in (-1, 1):
        offset = y * (DOOR_THICKNESS / 2 - 0.003)
        for z, panel_h in rows:
            b.box(raised, (w - 0.26, 0.006, panel_h), (0, offset, z))
        b.box(metal, (0.12, 0.018, 0.02), (w / 2 - 0.1, y * (DOOR_THICKNESS / 2 + 0.009), 1.02))


def door_frame(b: Builder, index: int) -> None:
    """The lining of a doorway or a wide passage."""
    clear = (*DOOR_WIDTHS, *PASSAGE_WIDTHS)[index - 1]
    wood = b.slot("wood", ("wood", "paint"))
    depth, h = WALL_THICKNESS + 2 * CASING, DOOR_HEIGHT
    for x in (-1, 1):
        b.box(wood, (LINING, depth, h), (x * (clear + LINING) / 2, 0, 0))
    b.box(wood, (clear + 2 * LINING, depth, LINING), (0, 0, h))


RECIPES = {"window": window, "door": door, "door_frame": door_frame}
