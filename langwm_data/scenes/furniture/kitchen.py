"""Recipes for kitchens. Everything in a row of counters shares one depth and one height."""

from langwm_data.scenes.furniture.model import BOARD, STONE_TOP, TOUGH, Builder
from langwm_data.scenes.furniture.storage import door_fronts, drawer_fronts
from langwm_data.scenes.geometry import axis_quat

UNIT_WIDTH = 0.6
COUNTER_DEPTH = 0.56
COUNTER_HEIGHT = 0.9
TOP = 0.04
PLINTH = 0.09
HOTPLATES = ((-0.14, -0.13), (0.14, -0.13), (-0.14, 0.13), (0.14, 0.13))
"""Where a pot stands on a stove, in the stove's own frame."""


def _counter_body(b: Builder, *, has_top: bool = True) -> tuple[int, int]:
    """Plinth, body and worktop of one unit; returns the slots of fronts and handles."""
    body, top = b.slot("cabinet", BOARD), b.slot("worktop", STONE_TOP)
    height = COUNTER_HEIGHT - TOP
    b.box(body, (UNIT_WIDTH, COUNTER_DEPTH - 0.06, PLINTH), (0, -0.03, 0))
    b.box(body, (UNIT_WIDTH, COUNTER_DEPTH, height - PLINTH), (0, 0, PLINTH))
    if has_top:
        b.box(top, (UNIT_WIDTH, COUNTER_DEPTH + 0.04, TOP), (0, 0.02, height))
    return body, b.slot("handle", ("metal",))


def kitchen_cabinet(b: Builder) -> None:
    """A base unit with a worktop: drawers, or doors."""
    fronts = _counter_body(b)
    body = (UNIT_WIDTH, COUNTER_DEPTH, COUNTER_HEIGHT - TOP - PLINTH)
    if b.coin():
        drawer_fronts(b, fronts, body, PLINTH, 1, 3)
    else:
        door_fronts(b, fronts, body, PLINTH, 2)


def kitchen_sink(b: Builder) -> None:
    """A base unit with a basin let into its worktop and a tap."""
    fronts = _counter_body(b, has_top=False)
    steel, top = b.slot("basin", ("metal", "porcelain")), 1
    door_fronts(b, fronts, (UNIT_WIDTH, COUNTER_DEPTH, COUNTER_HEIGHT - TOP - PLINTH), PLINTH, 2)
    z, rim = COUNTER_HEIGHT - TOP, 0.07
    b.box(steel, (UNIT_WIDTH - 2 * rim, COUNTER_DEPTH - 0.1, 0.004), (0, 0.02, z))
    for x in (-1, 1):
        b.box(top, (rim, COUNTER_DEPTH + 0.04, TOP), (x * (UNIT_WIDTH - rim) / 2, 0.02, z))
    for y, depth in ((-COUNTER_DEPTH / 2 + 0.05, 0.1), (COUNTER_DEPTH / 2 + 0.01, 0.06)):
        b.box(top, (UNIT_WIDTH - 2 * rim, depth, TOP), (0, y, z))
    tap, tall = b.slot("tap", ("metal",)), b.uniform(0.18, 0.3)
    y = -COUNTER_DEPTH / 2 + 0.06
    b.cylinder(tap, 0.03, tall, (0, y, COUNTER_HEIGHT))
    b.box(tap, (0.024, 0.17, 0.024), (0, y + 0.085, COUNTER_HEIGHT + tall))


def stove(b: Builder) -> None:
    """An oven below four hotplates."""
    body, glass = b.slot("body", ("metal", "plastic", "porcelain")), b.slot("window", ("metal",))
    h = COUNTER_HEIGHT
    b.box(body, (UNIT_WIDTH - 0.01, COUNTER_DEPTH, h - 0.02), (0, 0, 0))
    b.box(glass, (UNIT_WIDTH - 0.01, COUNTER_DEPTH, 0.02), (0, 0, h - 0.02))
    plate = b.slot("plates", ("metal", "plastic"))
    for x, y in HOTPLATES:
        b.cylinder(plate, 0.18 if y < 0 else 0.15, 0.008, (x, y, h))
    front = COUNTER_DEPTH / 2
    window = b.uniform(0.28, 0.38)
    b.box(glass, (UNIT_WIDTH - 0.1, 0.014, window), (0, front + 0.007, 0.2))
    b.box(plate, (UNIT_WIDTH - 0.12, 0.03, 0.02), (0, front + 0.015, window + 0.26))
    for i in range(4):
        knob = (0.12 * (i - 1.5), front + 0.0125, h - 0.11)
        b.box(plate, (0.036, 0.025, 0.036), knob)
    b.box(plate, (UNIT_WIDTH - 0.05, 0.012, 0.12), (0, front + 0.006, 0.03))


def dishwasher(b: Builder) -> None:
    """A machine under a worktop, with one wide front."""
    body, panel = b.slot("front", ("metal", "plastic", "porcelain")), b.slot("panel", TOUGH)
    top = b.slot("worktop", STONE_TOP)
    h, front = COUNTER_HEIGHT - TOP, COUNTER_DEPTH / 2
    b.box(panel, (UNIT_WIDTH, COUNTER_DEPTH - 0.06, PLINTH), (0, -0.03, 0))
    b.box(body, (UNIT_WIDTH, COUNTER_DEPTH, h - PLINTH), (0, 0, PLINTH))
    b.box(body, (UNIT_WIDTH - 0.02, 0.016, 0.6), (0, front + 0.008, PLINTH + 0.01))
    b.box(panel, (UNIT_WIDTH - 0.02, 0.018, 0.12), (0, front + 0.009, h - 0.14))
    b.box(panel, (b.uniform(0.2, 0.5), 0.024, 0.02), (0, front + 0.028, 0.62))
    b.box(top, (UNIT_WIDTH, COUNTER_DEPTH + 0.04, TOP), (0, 0.02, h))


def fridge(b: Builder) -> None:
    """A tall cold box with one or two doors."""
    body, handle = b.slot("body", ("metal", "porcelain", "plastic")), b.slot("handle", TOUGH)
    w, d, h = b.uniform(0.58, 0.66), b.uniform(0.56, 0.6), b.uniform(1.6, 1.9)
    b.box(handle, (w - 0.06, d - 0.06, 0.05), (0, 0, 0))
    b.box(body, (w, d, h - 0.05), (0, 0, 0.05))
    split = b.choice((0.5, 0.62, 1.25))
    for low, high in ((0.07, split), (split + 0.012, h)):
        b.box(body, (w - 0.004, 0.05, high - low), (0, d / 2 + 0.031, low))
        length = min(0.4, 0.55 * (high - low))
        near_split = high - length - 0.06 if high == split else low + 0.06
        b.box(handle, (0.022, 0.03, length), (-w / 2 + 0.06, d / 2 + 0.071, near_split))


def wall_cabinet(b: Builder) -> None:
    """A cupboard that hangs over the counter."""
    body = b.slot("cabinet", BOARD)
    h, d = b.uniform(0.55, 0.65), b.uniform(0.3, 0.34)
    b.box(body, (UNIT_WIDTH, d, h), (0, 0, 0))
    door_fronts(b, (body, b.slot("handle", ("metal",))), (UNIT_WIDTH, d, h), 0.0, 2)


def range_hood(b: Builder) -> None:
    """A hood with a chimney over a stove."""
    steel = b.slot("steel", ("metal",))
    d = b.uniform(0.42, 0.48)
    b.box(steel, (UNIT_WIDTH - 0.02, d, 0.08), (0, 0, 0))
    b.box(steel, (0.42, 0.3, 0.1), (0, -d / 2 + 0.15, 0.08))
    b.box(steel, (0.24, 0.22, 0.42), (0, -d / 2 + 0.11, 0.18))


def microwave(b: Builder) -> None:
    """A small oven for a worktop."""
    body, window = b.slot("body", TOUGH), b.slot("window", ("metal", "plastic"))
    w, d, h = b.uniform(0.44, 0.5), b.uniform(0.32, 0.36), b.uniform(0.25, 0.29)
    b.box(body, (w, d, h), (0, 0, 0))
    b.box(window, (0.66 * w, 0.012, 0.76 * h), (-0.13 * w, d / 2 + 0.006, 0.12 * h))
    b.box(window, (0.02, 0.03, 0.7 * h), (0.24 * w, d / 2 + 0.015, 0.15 * h))
    for i in range(3):
        b.box(window, (0.05, 0.012, 0.03), (0.37 * w, d / 2 + 0.006, (0.2 + 0.25 * i) * h))


def trash_can(b: Builder) -> None:
    """A bin with a lid: round and widening, or square with a pedal."""
    body, lid = b.slot("body", TOUGH), b.slot("lid", TOUGH)
    h = b.uniform(0.42, 0.62)
    if b.coin():
        w = b.uniform(0.28, 0.34)
        b.frustum(body, 0.78 * w, w, h - 0.05, (0, 0, 0))
        b.cylinder(lid, w + 0.015, 0.05, (0, 0, h - 0.05))
        return
    w = b.uniform(0.27, 0.33)
    b.box(body, (w, w, h - 0.06), (0, 0, 0))
    b.box(lid, (w + 0.015, w + 0.015, 0.06), (0, 0, h - 0.06))
    b.box(lid, (0.09, 0.05, 0.016), (0, w / 2 + 0.025, 0.02))


def cooking_pot(b: Builder) -> None:
    """A pot with two handles and a lid."""
    body, knob = b.slot("body", ("metal", "porcelain")), b.slot("knob", ("plastic", "wood"))
    w, h = b.uniform(0.2, 0.26), b.uniform(0.11, 0.16)
    b.cylinder(body, w, h, (0, 0, 0))
    b.cylinder(body, w + 0.012, 0.012, (0, 0, h))
    b.cylinder(knob, 0.035, 0.03, (0, 0, h + 0.012))
    for x in (-1, 1):
        b.cylinder(knob, 0.022, 0.05, (x * (w / 2 + 0.015), 0, 0.7 * h - 0.02), axis_quat((1, 0, 0), 1.5708))


RECIPES = {
    "kitchen_cabinet": kitchen_cabinet,
    "kitchen_sink": kitchen_sink,
    "stove": stove,
    "dishwasher": dishwasher,
    "fridge": fridge,
    "wall_cabinet": wall_cabinet,
    "range_hood": range_hood,
    "microwave": microwave,
    "trash_can": trash_can,
    "cooking_pot": cooking_pot,
}
