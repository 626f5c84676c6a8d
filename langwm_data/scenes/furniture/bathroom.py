"""Recipes for bathrooms and laundry."""

from langwm_data.scenes.furniture.model import BOARD, TOUGH, WHITEWARE, Builder
from langwm_data.scenes.furniture.storage import door_fronts
from langwm_data.scenes.geometry import axis_quat


def toilet(b: Builder) -> None:
    """Foot, bowl, seat and cistern."""
    ware, seat = b.slot("ware", WHITEWARE), b.slot("seat", ("plastic", "wood", "porcelain"))
    w, d, h = b.uniform(0.35, 0.38), b.uniform(0.62, 0.68), b.uniform(0.39, 0.42)
    bowl = d - 0.2
    b.box(ware, (0.22, bowl, 0.2), (0, -0.02, 0))
    b.frustum(ware, 0.62 * w, w, h - 0.14, (0, d / 2 - w / 2, 0.1))
    b.box(ware, (w - 0.02, bowl - w / 2, h - 0.24), (0, d / 2 - w / 2 - (bowl - w / 2) / 2, 0.2))
    b.box(seat, (w, bowl - w / 2, 0.03), (0, d / 2 - w / 2 - (bowl - w / 2) / 2, h - 0.04))
    b.cylinder(seat, w, 0.03, (0, d / 2 - w / 2, h - 0.04))
    b.box(ware, (0.38, 0.17, 0.42), (0, -d / 2 + 0.085, h - 0.06))
    b.box(ware, (0.4, 0.19, 0.03), (0, -d / 2 + 0.095, h + 0.36))
    b.box(b.slot("button", ("metal",)), (0.06, 0.04, 0.012), (0, -d / 2 + 0.09, h + 0.39))


def washbasin(b: Builder) -> None:
    """A basin on a pedestal or on a small cupboard, with a tap."""
    ware, tap = b.slot("ware", WHITEWARE), b.slot("tap", ("metal",))
    w, d, h = b.uniform(0.5, 0.62), b.uniform(0.4, 0.46), b.uniform(0.82, 0.86)
    if b.coin(0.45):
        b.box(ware, (0.18, 0.18, h - 0.14), (0, -0.06, 0))
        b.frustum(ware, 0.3, 0.4, 0.06, (0, -0.01, h - 0.2))
    else:
        body = b.slot("body", BOARD)
        b.legs(body, (w - 0.06, d - 0.08), 0.04, 0.16)
        b.box(body, (w - 0.04, d - 0.06, h - 0.3), (0, -0.02, 0.16))
        door_fronts(b, (body, tap), (w - 0.04, d - 0.1, h - 0.32), 0.17, 2)
    b.box(ware, (w, d, 0.1), (0, 0, h - 0.14))
    for x in (-1, 1):
        b.box(ware, (0.05, d, 0.04), (x * (w - 0.05) / 2, 0, h - 0.04))
    for y, depth in ((-d / 2 + 0.06, 0.12), (d / 2 - 0.025, 0.05)):
        b.box(ware, (w - 0.1, depth, 0.04), (0, y, h - 0.04))
    b.cylinder(tap, 0.03, 0.13, (0, -d / 2 + 0.06, h))
    b.box(tap, (0.024, 0.13, 0.022), (0, -d / 2 + 0.12, h + 0.11))


def bathtub(b: Builder) -> None:
    """A tub in a casing, long side to the wall."""
    casing, ware = b.slot("casing", ("tiles", "porcelain", "plastic")), b.slot("ware", WHITEWARE)
    w, d, h, rim = b.uniform(1.5, 1.72), b.uniform(0.7, 0.78), b.uniform(0.52, 0.58), 0.07
    b.box(casing, (w - 0.01, d - 0.01, h - 0.36), (0, 0, 0))
    b.box(ware, (w - 0.02, d - 0.02, 0.02), (0, 0, h - 0.36))
    for x in (-1, 1):
        b.box(casing, (rim, d - 0.01, 0.31), (x * (w - 0.01 - rim) / 2, 0, h - 0.34))
        b.box(ware, (rim + 0.01, d, 0.03), (x * (w - rim - 0.01) / 2, 0, h - 0.03))
    for y in (-1, 1):
        b.box(casing, (w - 0.01 - 2 * rim, rim, 0.31), (0, y * (d - 0.01 - rim) / 2, h - 0.34))
        b.box(ware, (w - 2 * rim - 0.02, rim + 0.01, 0.03), (0, y * (d - rim - 0.01) / 2, h - 0.03))
    tap = b.slot("tap", ("metal",))
    b.box(tap, (0.05, 0.05, 0.12), (-w / 2 + 0.05, 0, h))
    b.box(tap, (0.16, 0.03, 0.03), (-w / 2 + 0.12, 0, h + 0.12))


def shower(b: Builder) -> None:
    """A tray, a wall of panels to one side, a riser with a head."""
    ware, metal = b.slot("tray", ("porcelain", "terrazzo", "tiles")), b.slot("metal", ("metal",))
    screen = b.slot("curtain", ("plastic", "fabric"))
    w, h = b.uniform(0.82, 0.92), 2.0
    b.box(ware, (w, w, 0.1), (0, 0, 0))
    b.cylinder(metal, 0.024, h - 0.1, (0, -w / 2 + 0.03, 0.1))
    b.box(metal, (0.024, 0.22, 0.024), (0, -w / 2 + 0.14, h))
    b.cylinder(metal, 0.18, 0.02, (0, -w / 2 + 0.22, h - 0.02))
    b.box(metal, (0.1, 0.06, 0.06), (0, -w / 2 + 0.07, 1.0))
    b.box(metal, (w, 0.024, 0.024), (0, w / 2 - 0.03, h - 0.05))
    for i in range(4):
        at = (-w / 2 + 0.045 + 0.075 * i, w / 2 - 0.03 - 0.015 * (i % 2), 0.12)
        b.box(screen, (0.07, 0.03, h - 0.17), at)
    for x in (-1, 1):
        b.box(metal, (0.024, 0.024, h - 0.15), (x * (w / 2 - 0.012), w / 2 - 0.03, 0.1))


def mirror(b: Builder) -> None:
    """A framed glass for a wall; also tall ones for a hallway."""
    frame, glass = b.slot("frame", ("wood", "metal", "paint")), b.slot("glass", ("metal", "porcelain"))
    w, h = (b.uniform(0.45, 0.75), b.uniform(0.6, 0.9))
    b.box(glass, (w - 0.06, 0.012, h - 0.06), (0, -0.004, 0.03))
    for x in (-1, 1):
        b.box(frame, (0.03, 0.025, h), (x * (w - 0.03) / 2, 0, 0))
    for z in (0.0, h - 0.03):
        b.box(frame, (w - 0.06, 0.025, 0.03), (0, 0, z))


def washing_machine(b: Builder) -> None:
    """A cube with a porthole and a panel."""
    body, ring = b.slot("body", ("porcelain", "plastic", "metal")), b.slot("ring", ("metal",))
    glass = b.slot("glass", ("plastic", "metal"))
    w, d, h = 0.6, b.uniform(0.52, 0.58), 0.85
    upright = axis_quat((1, 0, 0), 1.5708)
    b.box(body, (w, d, h), (0, 0, 0))
    b.cylinder(ring, 0.36, 0.03, (0, d / 2 + 0.015, 0.425), upright)
    b.cylinder(glass, 0.28, 0.03, (0, d / 2 + 0.04, 0.425), upright)
    b.box(glass, (0.56, 0.014, 0.1), (0, d / 2 + 0.007, h - 0.13))
    b.box(ring, (0.1, 0.03, 0.05), (0.16, d / 2 + 0.02, h - 0.105))


def laundry_basket(b: Builder) -> None:
    """A basket that widens upwards, with washing in it, or a hamper with a lid."""
    body = b.slot("body", ("wood", "fabric", "plastic"))
    h = b.uniform(0.45, 0.6)
    if b.coin():
        w = b.uniform(0.36, 0.42)
        b.frustum(body, 0.8 * w, w, h - 0.06, (0, 0, 0))
        b.cylinder(body, w + 0.02, 0.03, (0, 0, h - 0.06))
        b.ellipsoid(b.slot("washing", ("fabric",)), (0.8 * w, 0.8 * w, 0.14), (0, 0, h - 0.1))
        return
    w, d = b.uniform(0.38, 0.44), b.uniform(0.3, 0.34)
    b.box(body, (w, d, h - 0.04), (0, 0, 0))
    b.box(b.slot("lid", ("wood", "fabric")), (w + 0.02, d + 0.02, 0.04), (0, 0, h - 0.04))


def towel_rail(b: Builder) -> None:
    """A ladder of bars on a wall with a towel over it."""
    bars, towel = b.slot("bars", TOUGH), b.slot("towel", ("fabric", "fabric_carpet"))
    w, h = b.uniform(0.48, 0.6), b.uniform(0.8, 1.1)
    for x in (-1, 1):
        b.box(bars, (0.03, 0.07, h), (x * (w - 0.03) / 2, 0, 0))
    for i in range(5):
        b.box(bars, (w - 0.06, 0.025, 0.03), (0, 0, 0.03 + i * (h - 0.09) / 4))
    b.box(towel, (0.6 * w, 0.05, 0.5 * h), (0.04, 0.04, 0.45 * h))


RECIPES = {
    "toilet": toilet,
    "washbasin": washbasin,
    "bathtub": bathtub,
    "shower": shower,
    "mirror": mirror,
    "washing_machine": washing_machine,
    "laundry_basket": laundry_basket,
    "towel_rail": towel_rail,
}
