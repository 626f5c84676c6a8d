"""Recipes for what hangs on walls or lies on floors, and for small loose things."""

import math

from langwm_data.scenes.furniture.model import CLOTH, TOUGH, Builder
from langwm_data.scenes.geometry import axis_quat, quat_product, yaw_quat

RUG_HEIGHT = 0.01
"""Low enough for the robot to drive over."""


def picture(b: Builder) -> None:
    """A framed picture: a mount, and shapes of other materials on it."""
    frame = b.slot("frame", ("wood", "metal", "plastic"))
    ground, motif = (
        b.slot("ground", ("paint", "plaster", "fabric")),
        b.slot("motif", ("moss", "rocks", "ground")),
    )
    w, h = b.uniform(0.4, 0.95), b.uniform(0.4, 0.75)
    b.box(ground, (w - 0.06, 0.012, h - 0.06), (0, -0.004, 0.03))
    for x in (-1, 1):
        b.box(frame, (0.03, 0.028, h), (x * (w - 0.03) / 2, 0, 0))
    for z in (0.0, h - 0.03):
        b.box(frame, (w - 0.06, 0.028, 0.03), (0, 0, z))
    b.box(motif, (w - 0.16, 0.004, b.uniform(0.3, 0.6) * h), (0, 0.004, 0.08))


def curtain(b: Builder) -> None:
    """One drawn-back curtain hanging in folds from a piece of rail; short, or down to the floor."""
    cloth, rail = b.slot("cloth", CLOTH), b.slot("rail", ("metal", "wood"))
    drop, num = b.choice(CURTAIN_DROPS), 3 + int(b.rng.integers(2))
    for i in range(num):
        b.box(cloth, (0.08, 0.045, drop - 0.03), (0.082 * (i - (num - 1) / 2), 0.02 * (i % 2) - 0.01, 0))
    b.box(rail, (0.082 * num + 0.03, 0.03, 0.03), (0, 0, drop - 0.03))
    b.box(rail, (0.03, 0.05, 0.03), (0, -0.04, drop - 0.03))


CURTAIN_DROPS = (1.4, 2.2)
"""Lengths of short and of long curtains, metres."""


def radiator(b: Builder) -> None:
    """A heater of ribs with a pipe, on the wall below a window."""
    body = b.slot("body", ("metal", "paint"))
    num, h = 5 + int(b.rng.integers(3)), b.uniform(0.48, 0.58)
    for i in range(num):
        b.box(body, (0.1, 0.08, h), ((i - (num - 1) / 2) * 0.13, 0, 0.1))
    for z in (0.14, h + 0.03):
        b.box(body, (num * 0.13 - 0.05, 0.03, 0.03), (0, 0, z))
    b.box(body, (0.03, 0.03, 0.1), ((num - 1) / 2 * 0.13, 0, 0))


def rug(b: Builder) -> None:
    """A flat carpet, rectangular with a border, or round."""
    field, border = (
        b.slot("field", ("fabric_carpet", "fabric")),
        b.slot("border", ("fabric_carpet", "fabric")),
    )
    w = b.choice((0.8, 1.2, 1.6, 2.0))
    if b.coin(0.2):
        b.cylinder(field, min(w, 1.6), RUG_HEIGHT, (0, 0, 0))
        return
    d = b.choice((0.55, 0.7)) if w < 1.0 else round(b.uniform(0.6, 0.7) * w, 2)
    rim = 0.06
    b.box(field, (w - 2 * rim, d - 2 * rim, RUG_HEIGHT), (0, 0, 0))
    for x in (-1, 1):
        b.box(border, (rim, d, RUG_HEIGHT), (x * (w - rim) / 2, 0, 0))
    for y in (-1, 1):
        b.box(border, (w - 2 * rim, rim, RUG_HEIGHT), (0, y * (d - rim) / 2, 0))


def potted_plant(b: Builder) -> None:
    """A pot with soil, a stem, and blades that fan out from it in rising circles."""
    pot = b.slot("pot", ("porcelain", "concrete", "terrazzo", "plastic", "rocks"))
    leaf, soil = b.slot("leaves", ("moss",)), b.slot("soil", ("ground",))
    w, pot_h, h = b.uniform(0.26, 0.38), b.uniform(0.24, 0.36), b.uniform(0.7, 1.2)
    b.frustum(pot, 0.75 * w, w, pot_h, (0, 0, 0))
    b.cylinder(soil, 0.85 * w, 0.012, (0, 0, pot_h))
    stem_top = pot_h + 0.6 * (h - pot_h)
    b.box(b.slot("stem", ("wood",)), (0.025, 0.025, stem_top - pot_h), (0, 0, pot_h))
    num = 9 + int(b.rng.integers(4))
    for i in range(num):
        level = i / (num - 1)
        angle, rise = 2.4 * i, 0.35 + 0.9 * level
        length = b.uniform(0.3, 0.38) * (1.15 - 0.4 * level)
        reach, z = 0.5 * length * math.cos(rise), pot_h + 0.06 + level * (stem_top - pot_h - 0.06)
        at = (reach * math.cos(angle), reach * math.sin(angle), z + 0.5 * length * math.sin(rise))
        turn = quat_product(yaw_quat(angle), axis_quat((0, 1, 0), -rise))
        b.box(leaf, (length, b.uniform(0.09, 0.13), 0.01), at, turn)


def cup(b: Builder) -> None:
    """A mug with a handle."""
    ware = b.slot("ware", ("porcelain", "metal", "plastic"))
    w, h = b.uniform(0.075, 0.095), b.uniform(0.085, 0.11)
    b.cylinder(ware, w, h, (0, 0, 0))
    b.box(ware, (0.03, 0.012, 0.6 * h), (w / 2 + 0.012, 0, 0.2 * h))


def bowl(b: Builder) -> None:
    """A bowl with fruit in it."""
    ware, fruit = (
        b.slot("ware", ("porcelain", "wood", "metal")),
        b.slot("fruit", ("paint", "moss", "plastic")),
    )
    w, h = b.uniform(0.2, 0.28), b.uniform(0.07, 0.1)
    b.frustum(ware, 0.55 * w, w, h, (0, 0, 0))
    for i in range(3):
        angle = 2.1 * i
        at = (0.2 * w * math.cos(angle), 0.2 * w * math.sin(angle), h - 0.02)
        b.ellipsoid(fruit, (0.07, 0.07, 0.07), at)


def bottle(b: Builder) -> None:
    """A bottle with neck and cap."""
    glass, cap = b.slot("body", ("plastic", "porcelain", "metal")), b.slot("cap", ("metal", "plastic"))
    w, h = b.uniform(0.07, 0.09), b.uniform(0.22, 0.3)
    b.cylinder(glass, w, 0.62 * h, (0, 0, 0))
    b.frustum(glass, w, 0.4 * w, 0.18 * h, (0, 0, 0.62 * h))
    b.cylinder(glass, 0.4 * w, 0.14 * h, (0, 0, 0.8 * h))
    b.cylinder(cap, 0.45 * w, 0.06 * h, (0, 0, 0.94 * h))


def book(b: Builder) -> None:
    """One to three books lying on each other."""
    covers = [b.slot(f"cover_{i}", ("leather", "fabric", "plastic")) for i in range(2)]
    z = 0.0
    for i in range(1 + int(b.rng.integers(3))):
        size = (b.uniform(0.2, 0.24) - 0.015 * i, b.uniform(0.14, 0.17) - 0.012 * i, b.uniform(0.025, 0.04))
        b.box(covers[i % 2], size, (0, 0, z))
        z += size[2]


def vase(b: Builder) -> None:
    """A vase, some with flowers."""
    ware = b.slot("ware", ("porcelain", "marble", "metal", "terrazzo"))
    w, h = b.uniform(0.11, 0.15), b.uniform(0.16, 0.24)
    b.frustum(ware, 0.75 * w, w, 0.5 * h, (0, 0, 0))
    b.frustum(ware, w, 0.5 * w, 0.38 * h, (0, 0, 0.5 * h))
    b.frustum(ware, 0.5 * w, 0.62 * w, 0.12 * h, (0, 0, 0.88 * h))
    if b.coin(0.6):
        stem, flower = b.slot("stems", ("moss",)), b.slot("flowers", ("paint", "fabric"))
        b.cylinder(stem, 0.03, 0.12, (0, 0, h))
        b.ellipsoid(flower, (0.14, 0.14, 0.1), (0, 0, h + 0.1))


def ball(b: Builder) -> None:
    """A toy ball."""
    w = b.uniform(0.14, 0.24)
    b.ellipsoid(b.slot("skin", ("plastic", "leather", "paint")), (w, w, w), (0, 0, 0))


def cardboard_box(b: Builder) -> None:
    """A closed carton with a strip of tape."""
    board, tape = b.slot("board", ("wood", "plaster", "ground")), b.slot("tape", ("plastic", "fabric"))
    w, d, h = b.uniform(0.28, 0.45), b.uniform(0.24, 0.34), b.uniform(0.2, 0.34)
    b.box(board, (w, d, h), (0, 0, 0))
    b.box(tape, (w + 0.004, 0.05, 0.003), (0, 0, h))
    for x in (-1, 1):
        b.box(tape, (0.003, 0.05, 0.08), (x * (w + 0.003) / 2, 0, h - 0.08))


def toy_car(b: Builder) -> None:
    """A big toy car with four wheels."""
    body, wheel = b.slot("body", ("paint", "plastic", "wood")), b.slot("wheels", TOUGH)
    length, w = b.uniform(0.24, 0.32), b.uniform(0.12, 0.15)
    b.box(body, (w, length, 0.06), (0, 0, 0.03))
    b.box(body, (w - 0.02, 0.5 * length, 0.055), (0, -0.06 * length, 0.09))
    turned = axis_quat((0, 1, 0), math.pi / 2)
    for x in (-1, 1):
        for y in (-1, 1):
            b.cylinder(wheel, 0.065, 0.025, (x * (w / 2 + 0.0125), y * 0.3 * length, 0.02), turned)


def shoe(b: Builder) -> None:
    """A pair of shoes side by side."""
    upper, sole = b.slot("upper", ("leather", "fabric")), b.slot("sole", ("plastic", "leather"))
    length = b.uniform(0.25, 0.3)
    for x in (-0.06, 0.06):
        b.box(sole, (0.095, length, 0.022), (x, 0, 0))
        b.box(upper, (0.085, 0.55 * length, 0.04), (x, 0.2 * length, 0.022))
        b.box(upper, (0.085, 0.42 * length, 0.085), (x, -0.27 * length, 0.022))
    b.box(sole, (0.035, 0.04, 0.02), (0, -0.2 * length, 0.03))


RECIPES = {
    "picture": picture,
    "curtain": curtain,
    "radiator": radiator,
    "rug": rug,
    "potted_plant": potted_plant,
    "cup": cup,
    "bowl": bowl,
    "bottle": bottle,
    "book": book,
    "vase": vase,
    "ball": ball,
    "cardboard_box": cardboard_box,
    "toy_car": toy_car,
    "shoe": shoe,
}
