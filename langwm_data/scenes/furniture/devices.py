"""Recipes for lamps and electrical devices."""

from langwm_data.scenes.furniture.model import METAL, TOUGH, WOODEN, Builder

SHADE = ("fabric", "plastic", "porcelain", "metal")


def tv(b: Builder) -> None:
    """A flat television on two feet."""
    case, screen = b.slot("case", TOUGH), b.slot("screen", ("plastic", "metal"))
    w = b.uniform(0.95, 1.3)
    h = round(0.57 * w, 3)
    b.box(case, (w, 0.045, h), (0, 0, 0.06))
    b.box(screen, (w - 0.04, 0.008, h - 0.05), (0, 0.0265, 0.09))
    for x in (-1, 1):
        b.box(case, (0.04, 0.24, 0.015), (x * 0.32 * w, 0, 0))
        b.box(case, (0.03, 0.03, 0.045), (x * 0.32 * w, 0, 0.015))


def monitor(b: Builder) -> None:
    """A computer screen on a stand."""
    case, screen = b.slot("case", TOUGH), b.slot("screen", ("plastic", "metal"))
    w, foot = b.uniform(0.5, 0.62), b.uniform(0.1, 0.14)
    h = round(0.6 * w, 3)
    b.box(case, (0.24, 0.18, 0.015), (0, 0, 0))
    b.box(case, (0.05, 0.03, foot + 0.1), (0, -0.04, 0.015))
    b.box(case, (w, 0.035, h), (0, -0.005, foot))
    b.box(screen, (w - 0.03, 0.006, h - 0.03), (0, 0.0155, foot + 0.015))


def keyboard(b: Builder) -> None:
    """A keyboard with rows of keys, and a mouse."""
    case, keys = b.slot("case", TOUGH), b.slot("keys", ("plastic",))
    w = b.uniform(0.32, 0.44)
    b.box(case, (w, 0.14, 0.018), (0, 0, 0))
    for i in range(4):
        b.box(keys, (w - 0.03, 0.024, 0.006), (0, -0.048 + 0.032 * i, 0.018))
    b.ellipsoid(keys, (0.06, 0.1, 0.036), (w / 2 + 0.07, 0, 0))


def floor_lamp(b: Builder) -> None:
    """A foot, a pole and a shade."""
    metal, shade = b.slot("pole", ("metal", "wood")), b.slot("shade", SHADE)
    h, w = b.uniform(1.4, 1.65), b.uniform(0.3, 0.42)
    shade_h = b.uniform(0.22, 0.32)
    b.cylinder(metal, b.uniform(0.26, 0.3), 0.025, (0, 0, 0))
    b.cylinder(metal, 0.03, h - shade_h - 0.025, (0, 0, 0.025))
    b.frustum(shade, w, b.uniform(0.5, 0.95) * w, shade_h, (0, 0, h - shade_h))


def table_lamp(b: Builder) -> None:
    """A body and a shade, for a nightstand or a desk."""
    body, shade = b.slot("body", ("porcelain", "wood", "metal", "marble")), b.slot("shade", SHADE)
    h, w = b.uniform(0.36, 0.48), b.uniform(0.2, 0.26)
    b.cylinder(body, 0.12, 0.02, (0, 0, 0))
    if b.coin():
        b.ellipsoid(body, (0.13, 0.13, 0.17), (0, 0, 0.015))
        b.cylinder(body, 0.02, h - 0.34, (0, 0, 0.175))
    else:
        b.cylinder(body, 0.035, h - 0.2, (0, 0, 0.02))
    b.frustum(shade, w, b.uniform(0.55, 0.9) * w, 0.18, (0, 0, h - 0.18))


def ceiling_lamp(b: Builder) -> None:
    """A rod from the ceiling with a drum or a cone below it."""
    metal, shade = b.slot("mount", METAL), b.slot("shade", SHADE)
    drop, w = b.uniform(0.08, 0.3), b.uniform(0.28, 0.45)
    height = b.uniform(0.14, 0.22)
    b.frustum(shade, w, b.choice((0.3, 0.8, 1.0)) * w, height, (0, 0, 0))
    b.box(metal, (0.02, 0.02, drop), (0, 0, height))
    b.box(metal, (0.12, 0.12, 0.03), (0, 0, height + drop))


def piano(b: Builder) -> None:
    """An upright piano."""
    body, keys = b.slot("body", (*WOODEN, "paint")), b.slot("keys", ("porcelain", "plastic"))
    w, h = b.uniform(1.42, 1.5), b.uniform(1.12, 1.25)
    b.box(body, (w, 0.34, h - 0.03), (0, -0.13, 0))
    b.box(body, (w + 0.03, 0.37, 0.03), (0, -0.13, h - 0.03))
    b.box(body, (w, 0.26, 0.1), (0, 0.17, 0.6))
    b.box(keys, (w - 0.16, 0.15, 0.025), (0, 0.2, 0.7))
    for x in (-1, 1):
        b.box(body, (0.07, 0.25, 0.09), (x * (w - 0.07) / 2, 0.165, 0.7))
        b.box(body, (0.07, 0.07, 0.6), (x * (w / 2 - 0.06), 0.24, 0))
    b.box(body, (0.6, 0.03, 0.22), (0, 0.06, 0.8))
    b.box(b.slot("pedals", METAL), (0.22, 0.08, 0.03), (0, 0.08, 0.06))


RECIPES = {
    "tv": tv,
    "monitor": monitor,
    "keyboard": keyboard,
    "floor_lamp": floor_lamp,
    "table_lamp": table_lamp,
    "ceiling_lamp": ceiling_lamp,
    "piano": piano,
}
