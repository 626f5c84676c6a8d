"""Recipes for what people sit and lie on."""

import math

from langwm_data.scenes.furniture.model import CLOTH, SOFT, TOUGH, WOODEN, Builder
from langwm_data.scenes.geometry import axis_quat, yaw_quat


def chair(b: Builder) -> None:
    """A dining chair without arms: four legs, a seat, a back of slats or of one board."""
    frame = b.slot("frame", (*WOODEN, "metal"))
    seat = b.slot("seat", (*SOFT, "wood", "plastic"))
    w, d, height = b.uniform(0.42, 0.47), b.uniform(0.42, 0.48), b.uniform(0.82, 0.98)
    post, seat_z = b.uniform(0.03, 0.042), b.uniform(0.40, 0.42)
    b.legs(frame, (w, d), post, seat_z)
    b.box(seat, (w, d, 0.045), (0, 0, seat_z))
    back_z, back_y = seat_z + 0.045, -(d - post) / 2
    for x in (-1, 1):
        b.box(frame, (post, post, height - back_z), (x * (w - post) / 2, back_y, back_z))
    inner = w - 2 * post
    style = int(b.rng.integers(3))
    if style == 0:
        b.box(seat, (inner, 0.03, 0.28), (0, back_y, height - 0.32))
    elif style == 1:
        for i in range(3):
            b.box(frame, (inner, 0.02, 0.05), (0, back_y, height - 0.07 - i * 0.11))
    else:
        b.box(frame, (inner, 0.025, 0.06), (0, back_y, height - 0.07))
        for i in range(3):
            b.box(frame, (0.025, 0.015, height - 0.07 - back_z), ((i - 1) * inner / 3.5, back_y, back_z))


def armchair(b: Builder) -> None:
    """A low upholstered seat for one."""
    _upholstered(b, width=b.uniform(0.78, 0.95), num_seats=1)


def sofa(b: Builder) -> None:
    """An upholstered seat for two or three."""
    num_seats = 2 + int(b.rng.integers(2))
    _upholstered(b, width=0.5 + num_seats * b.uniform(0.56, 0.64), num_seats=num_seats)


def _upholstered(b: Builder, *, width: float, num_seats: int) -> None:
    cover, feet = b.slot("cover", SOFT), b.slot("feet", (*WOODEN, "metal"))
    d, arm, foot = b.uniform(0.82, 0.94), b.uniform(0.12, 0.2), b.uniform(0.06, 0.14)
    seat_z, back_h = b.uniform(0.27, 0.31), b.uniform(0.76, 0.9)
    b.legs(feet, (width - 0.06, d - 0.06), 0.05, foot)
    b.box(cover, (width, d, seat_z - foot), (0, 0, foot))
    inner, back = width - 2 * arm, 0.2
    b.box(cover, (inner, back, back_h - seat_z), (0, -(d - back) / 2, seat_z))
    arm_h = b.uniform(0.2, 0.3)
    for x in (-1, 1):
        b.box(cover, (arm, d, arm_h), (x * (width - arm) / 2, 0, seat_z))
    cushion = inner / num_seats
    fill = b.slot("cushions", SOFT) if b.coin(0.4) else cover
    for i in range(num_seats):
        x = (i - (num_seats - 1) / 2) * cushion
        b.box(fill, (cushion - 0.012, d - back - 0.01, 0.14), (x, back / 2 + 0.01, seat_z + 0.004))
        b.box(fill, (cushion - 0.03, 0.13, 0.34), (x, -d / 2 + back + 0.075, seat_z + 0.148))


def stool(b: Builder) -> None:
    """A round seat on three or four legs."""
    frame, seat = b.slot("frame", (*WOODEN, "metal")), b.slot("seat", (*SOFT, *WOODEN))
    height, diameter = b.uniform(0.42, 0.5), b.uniform(0.32, 0.38)
    num_legs = 3 + int(b.rng.integers(2))
    for i in range(num_legs):
        angle = 2 * math.pi * i / num_legs
        at = (0.36 * diameter * math.cos(angle), 0.36 * diameter * math.sin(angle), 0.0)
        b.cylinder(frame, 0.034, height, at)
    b.cylinder(frame, 0.7 * diameter, 0.02, (0, 0, 0.14))
    b.cylinder(seat, diameter, 0.045, (0, 0, height))


def bench(b: Builder) -> None:
    """A long low seat, on legs or on two side boards, some with a cushion."""
    frame = b.slot("frame", WOODEN)
    w, d, h = b.uniform(0.95, 1.25), b.uniform(0.34, 0.4), b.uniform(0.4, 0.45)
    if b.coin():
        b.legs(frame, (w - 0.06, d - 0.02), 0.05, h)
        b.box(frame, (w - 0.16, 0.03, 0.06), (0, 0, h - 0.1))
    else:
        for x in (-1, 1):
            b.box(frame, (0.04, d - 0.02, h), (x * (w / 2 - 0.08), 0, 0))
        b.box(frame, (w - 0.2, d - 0.06, 0.025), (0, 0, 0.13))
    b.box(frame, (w, d, 0.035), (0, 0, h))
    if b.coin():
        b.box(b.slot("cushion", SOFT), (w - 0.04, d - 0.03, 0.05), (0, 0, h + 0.035))


def office_chair(b: Builder) -> None:
    """A swivel chair: five spokes on castors, a column, a padded seat and back."""
    frame, pad = b.slot("frame", TOUGH), b.slot("pad", SOFT)
    radius, w, height = b.uniform(0.27, 0.31), b.uniform(0.45, 0.5), b.uniform(0.9, 1.08)
    for i in range(5):
        angle = 2 * math.pi * i / 5 + math.pi / 2
        x, y = math.cos(angle), math.sin(angle)
        b.box(frame, (radius, 0.045, 0.035), (x * radius / 2, y * radius / 2, 0.06), yaw_quat(angle))
        b.ellipsoid(frame, (0.06, 0.06, 0.06), (x * (radius - 0.02), y * (radius - 0.02), 0.0))
    b.cylinder(frame, 0.06, 0.34, (0, 0, 0.06))
    b.box(pad, (w, w - 0.02, 0.08), (0, 0, 0.4))
    b.box(frame, (0.06, 0.03, 0.26), (0, -w / 2 - 0.01, 0.4))
    lean = axis_quat((1.0, 0.0, 0.0), 0.12)
    b.box(pad, (w - 0.04, 0.06, height - 0.56), (0, -w / 2 + 0.01, 0.56), lean)


def pouf(b: Builder) -> None:
    """A padded drum."""
    cover = b.slot("cover", (*SOFT, "fabric_carpet"))
    diameter, height = b.uniform(0.42, 0.55), b.uniform(0.34, 0.42)
    b.cylinder(b.slot("base", WOODEN), diameter - 0.06, 0.03, (0, 0, 0))
    b.cylinder(cover, diameter, height - 0.06, (0, 0, 0.03))
    b.cylinder(cover, diameter - 0.05, 0.03, (0, 0, height - 0.03))


def bed(b: Builder) -> None:
    """Headboard, frame, mattress, cover and pillows; variants from single to double."""
    frame, sheet = b.slot("frame", (*WOODEN, "leather", "fabric")), b.slot("sheet", ("fabric",))
    cover = b.slot("cover", CLOTH)
    mattress = b.choice((0.9, 0.9, 1.4, 1.6, 1.8))
    w, length = mattress + 0.08, b.uniform(2.02, 2.1)
    foot, base_h, head_h = b.uniform(0.08, 0.16), b.uniform(0.16, 0.2), b.uniform(0.8, 1.1)
    top = foot + base_h
    b.legs(frame, (w - 0.04, length - 0.1), 0.07, foot)
    b.box(frame, (w, length - 0.06, base_h), (0, 0.03, foot))
    b.box(frame, (w + 0.04, 0.06, head_h), (0, -length / 2 + 0.03, 0))
    b.box(sheet, (mattress, length - 0.1, 0.17), (0, 0.03, top))
    if b.coin(0.4):
        b.box(frame, (w, 0.04, top + 0.22), (0, length / 2 + 0.02, 0))
    blanket = b.uniform(1.2, 1.45)
    b.box(cover, (mattress + 0.05, blanket, 0.05), (0, length / 2 - 0.04 - blanket / 2, top + 0.17))
    num_pillows = 1 if mattress < 1.2 else 2
    pillow_w = min(0.66, mattress / num_pillows - 0.1)
    pillow = b.slot("pillow", ("fabric",))
    for i in range(num_pillows):
        x = (i - (num_pillows - 1) / 2) * mattress / num_pillows
        b.box(pillow, (pillow_w, 0.38, 0.11), (x, -length / 2 + 0.3, top + 0.172), axis_quat((1, 0, 0), 0.12))


RECIPES = {
    "chair": chair,
    "armchair": armchair,
    "sofa": sofa,
    "stool": stool,
    "bench": bench,
    "office_chair": office_chair,
    "pouf": pouf,
    "bed": bed,
}
