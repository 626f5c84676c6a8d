"""Recipes for what things are put on: tables, desks and consoles."""

import math

from langwm_data.scenes.furniture.model import STONE_TOP, WOODEN, Builder


def dining_table(b: Builder) -> None:
    """A table to sit at, rectangular on four legs or round on one."""
    top, frame = b.slot("top", (*WOODEN, "marble")), b.slot("frame", (*WOODEN, "metal"))
    h = b.uniform(0.73, 0.76)
    if b.coin(0.3):
        diameter = b.uniform(0.95, 1.2)
        b.cylinder(frame, 0.44, 0.03, (0, 0, 0))
        b.cylinder(frame, 0.09, h - 0.06, (0, 0, 0.03))
        b.cylinder(top, diameter, 0.03, (0, 0, h - 0.03))
        return
    w, d, leg = b.choice((1.2, 1.4, 1.6, 1.8)), b.uniform(0.8, 0.9), b.uniform(0.05, 0.08)
    b.legs(frame, (w - 0.06, d - 0.06), leg, h - 0.035)
    b.box(top, (w, d, 0.035), (0, 0, h - 0.035))
    for y in (-1, 1):
        b.box(frame, (w - 0.06 - 2 * leg, 0.02, 0.06), (0, y * (d / 2 - 0.05), h - 0.095))


def coffee_table(b: Builder) -> None:
    """A low table for in front of a sofa, some with a lower shelf."""
    top, frame = b.slot("top", (*WOODEN, "marble", "terrazzo")), b.slot("frame", (*WOODEN, "metal"))
    h = b.uniform(0.36, 0.45)
    if b.coin(0.3):
        diameter = b.uniform(0.65, 0.85)
        for i in range(4):
            angle = math.pi / 4 + i * math.pi / 2
            at = (0.36 * diameter * math.cos(angle), 0.36 * diameter * math.sin(angle), 0.0)
            b.cylinder(frame, 0.045, h - 0.03, at)
        b.cylinder(top, diameter, 0.03, (0, 0, h - 0.03))
        return
    w, d, leg = b.uniform(0.85, 1.15), b.uniform(0.5, 0.62), b.uniform(0.04, 0.07)
    b.legs(frame, (w - 0.02, d - 0.02), leg, h - 0.04)
    b.box(top, (w, d, 0.04), (0, 0, h - 0.04))
    if b.coin():
        b.box(top, (w - 0.04 - 2 * leg, d - 0.06, 0.02), (0, 0, 0.14))


def side_table(b: Builder) -> None:
    """A small table beside a seat: a round top on a column, or square on legs."""
    top, frame = b.slot("top", (*WOODEN, "marble", "metal")), b.slot("frame", (*WOODEN, "metal"))
    h, w = b.uniform(0.48, 0.58), b.uniform(0.36, 0.46)
    if b.coin():
        b.cylinder(frame, 0.7 * w, 0.02, (0, 0, 0))
        b.cylinder(frame, 0.045, h - 0.04, (0, 0, 0.02))
        b.cylinder(top, w, 0.02, (0, 0, h - 0.02))
        return
    b.legs(frame, (w, w), 0.035, h - 0.025)
    b.box(top, (w, w, 0.025), (0, 0, h - 0.025))


def desk(b: Builder) -> None:
    """A work table with drawers on one side and legs on the other."""
    top, body = b.slot("top", (*WOODEN, "plastic")), b.slot("body", (*WOODEN, "paint", "metal"))
    w, d, h = b.uniform(1.15, 1.5), b.uniform(0.6, 0.7), b.uniform(0.73, 0.76)
    side = -1 if b.coin() else 1
    b.box(top, (w, d, 0.03), (0, 0, h - 0.03))
    if b.coin(0.7):
        chest_w = 0.38
        x = side * (w / 2 - 0.02 - chest_w / 2)
        b.box(body, (chest_w, d - 0.06, h - 0.03), (x, -0.02, 0))
        handle = b.slot("handle", ("metal",))
        for i in range(3):
            b.box(top, (chest_w - 0.03, 0.016, 0.19), (x, d / 2 - 0.042, 0.06 + i * 0.215))
            b.box(handle, (0.12, 0.016, 0.016), (x, d / 2 - 0.026, 0.16 + i * 0.215))
    else:
        for y in (-1, 1):
            b.box(body, (0.05, 0.05, h - 0.03), (side * (w / 2 - 0.05), y * (d / 2 - 0.05), 0))
    for y in (-1, 1):
        b.box(body, (0.05, 0.05, h - 0.03), (-side * (w / 2 - 0.05), y * (d / 2 - 0.05), 0))
    b.box(body, (w - 0.5, 0.02, 0.3), (-side * 0.18, -d / 2 + 0.05, h - 0.36))


def console_table(b: Builder) -> None:
    """A narrow table for a hallway."""
    top, frame = b.slot("top", STONE_TOP), b.slot("frame", (*WOODEN, "metal"))
    w, d, h = b.uniform(0.8, 1.1), b.uniform(0.26, 0.32), b.uniform(0.74, 0.82)
    b.legs(frame, (w - 0.02, d - 0.02), 0.04, h - 0.03)
    b.box(top, (w, d, 0.03), (0, 0, h - 0.03))
    if b.coin():
        b.box(frame, (w - 0.12, d - 0.04, 0.02), (0, 0, 0.16))
    else:
        b.box(frame, (w - 0.1, d - 0.06, 0.12), (0, 0, h - 0.15))


RECIPES = {
    "dining_table": dining_table,
    "coffee_table": coffee_table,
    "side_table": side_table,
    "desk": desk,
    "console_table": console_table,
}
