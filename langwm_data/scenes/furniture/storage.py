"""Recipes for what things are kept in: chests of drawers, cupboards, shelves and racks."""

from langwm_data.scenes.furniture.model import BOARD, TOUGH, WOODEN, Builder
from langwm_data.scenes.geometry import axis_quat


def drawer_fronts(
    b: Builder, fronts: tuple[int, int], body: tuple[float, float, float], z: float, columns: int, rows: int
) -> None:
    """A grid of drawer fronts with bars for handles on the front of a body.

    Args:
        b: The builder.
        fronts: Slots of the front boards and of the handles.
        body: Width, depth and height that the fronts cover; the front lies at ``depth / 2``.
        z: Where the body starts.
        columns: How many side by side.
        rows: How many on top of each other.
    """
    board, handle = fronts
    w, d, h = body
    cell_w, cell_h = w / columns, h / rows
    for i in range(columns):
        for j in range(rows):
            x, low = (i + 0.5) * cell_w - w / 2, z + j * cell_h
            b.box(board, (cell_w - 0.02, 0.018, cell_h - 0.02), (x, d / 2 + 0.009, low + 0.01))
            b.box(handle, (0.3 * cell_w, 0.018, 0.018), (x, d / 2 + 0.027, low + cell_h / 2 - 0.009))


def door_fronts(
    b: Builder, fronts: tuple[int, int], body: tuple[float, float, float], z: float, num: int
) -> None:
    """Doors side by side with upright bars for handles; arguments as for ``drawer_fronts``."""
    board, handle = fronts
    w, d, h = body
    cell = w / num
    for i in range(num):
        x = (i + 0.5) * cell - w / 2
        side = 1 if i % 2 == 0 and num > 1 else -1
        b.box(board, (cell - 0.012, 0.018, h - 0.012), (x, d / 2 + 0.009, z + 0.006))
        length = min(0.3, 0.4 * h)
        at = (x + side * (cell / 2 - 0.045), d / 2 + 0.027, z + (h - length) / 2)
        b.box(handle, (0.018, 0.018, length), at)


def _body_and_fronts(b: Builder) -> tuple[int, int, int]:
    body = b.slot("body", BOARD)
    front = b.slot("front", BOARD) if b.coin(0.5) else body
    return body, front, b.slot("handle", ("metal",))


def nightstand(b: Builder) -> None:
    """A small chest for beside a bed."""
    body, front, handle = _body_and_fronts(b)
    w, d, h = b.uniform(0.4, 0.48), b.uniform(0.36, 0.42), b.uniform(0.46, 0.56)
    foot = b.uniform(0.06, 0.16)
    b.legs(body, (w - 0.02, d - 0.02), 0.035, foot)
    b.box(body, (w, d, h - foot), (0, 0, foot))
    drawer_fronts(b, (front, handle), (w, d, h - foot), foot, 1, 2)


def dresser(b: Builder) -> None:
    """A wide chest of drawers."""
    body, front, handle = _body_and_fronts(b)
    w, d, h = b.uniform(0.8, 1.2), b.uniform(0.42, 0.48), b.uniform(0.78, 0.95)
    b.legs(body, (w - 0.02, d - 0.02), 0.05, 0.08)
    b.box(body, (w, d, h - 0.08), (0, 0, 0.08))
    drawer_fronts(b, (front, handle), (w, d, h - 0.1), 0.08, 2 if w > 0.95 else 1, 4 if h > 0.86 else 3)


def sideboard(b: Builder) -> None:
    """A long low cupboard on legs."""
    body, front, handle = _body_and_fronts(b)
    w, d, h, foot = b.uniform(1.3, 1.6), b.uniform(0.4, 0.45), b.uniform(0.72, 0.82), b.uniform(0.1, 0.2)
    b.legs(body, (w - 0.1, d - 0.06), 0.045, foot)
    b.box(body, (w, d, h - foot), (0, 0, foot))
    door_fronts(b, (front, handle), (w, d, h - foot - 0.02), foot, 3 if b.coin() else 4)


def tv_stand(b: Builder) -> None:
    """A low bench for a television: two doors and an open middle."""
    body, front, handle = _body_and_fronts(b)
    w, d, h = b.uniform(1.2, 1.6), b.uniform(0.38, 0.45), b.uniform(0.42, 0.52)
    b.box(body, (w, d, 0.03), (0, 0, h - 0.03))
    b.box(body, (w, d, 0.03), (0, 0, 0.07))
    b.legs(body, (w - 0.1, d - 0.06), 0.05, 0.07)
    b.box(body, (w - 0.04, 0.02, h - 0.13), (0, -d / 2 + 0.02, 0.1))
    box_w = 0.32 * w
    for x in (-1, 1):
        at = x * (w - box_w) / 2
        b.box(body, (box_w, d - 0.06, h - 0.13), (at, 0.01, 0.1))
        b.box(front, (box_w - 0.02, 0.018, h - 0.15), (at, d / 2 - 0.011, 0.11))
        b.box(handle, (0.1, 0.016, 0.016), (at, d / 2 + 0.006, h - 0.12))
    b.box(body, (0.36 * w, d - 0.08, 0.02), (0, 0.01, 0.1 + (h - 0.13) / 2))


def wardrobe(b: Builder) -> None:
    """A tall cupboard with doors, some with drawers below."""
    body, front, handle = _body_and_fronts(b)
    num = 2 + int(b.rng.integers(2))
    w, d, h = num * b.uniform(0.45, 0.52), b.uniform(0.56, 0.6), b.uniform(1.95, 2.15)
    b.box(body, (w - 0.04, d - 0.05, 0.06), (0, -0.01, 0))
    b.box(body, (w, d, h - 0.06), (0, 0, 0.06))
    low = 0.06
    if b.coin():
        drawer_fronts(b, (front, handle), (w, d, 0.42), low, num, 2)
        low += 0.42
    door_fronts(b, (front, handle), (w, d, h - low), low, num)


def bookshelf(b: Builder) -> None:
    """An open shelf with rows of books in blocks of different height."""
    body = b.slot("body", BOARD)
    books = [b.slot(f"books_{i}", ("fabric", "leather", "plastic", "paint")) for i in range(3)]
    w, d = b.uniform(0.7, 0.95), b.uniform(0.27, 0.32)
    rows = b.rng.integers(3, 6)
    pitch, base = b.uniform(0.34, 0.38), 0.06
    h = base + rows * pitch + 0.025
    for x in (-1, 1):
        b.box(body, (0.025, d, h), (x * (w - 0.025) / 2, 0, 0))
    b.box(body, (w - 0.05, 0.012, h - base), (0, -d / 2 + 0.012, base))
    for i in range(rows + 1):
        b.box(body, (w - 0.05, d - 0.02, 0.025), (0, 0.01, base + i * pitch))
    for i in range(rows):
        x, right = -w / 2 + 0.03, w / 2 - 0.03
        while x < right - 0.08:
            run = min(b.uniform(0.1, 0.24), right - x)
            if b.coin(0.85):
                tall = b.uniform(0.19, 0.28)
                at = (x + run / 2, 0.01, base + i * pitch + 0.025)
                b.box(books[int(b.rng.integers(3))], (run - 0.004, b.uniform(0.16, 0.22), tall), at)
            x += run


def shoe_rack(b: Builder) -> None:
    """Two or three open boards with pairs of shoes."""
    frame, shoes = b.slot("frame", (*WOODEN, "metal")), b.slot("shoes", ("leather", "fabric"))
    w, d, num = b.uniform(0.65, 0.9), b.uniform(0.28, 0.32), 2 + int(b.rng.integers(2))
    h = 0.08 + 0.2 * num
    for x in (-1, 1):
        b.box(frame, (0.025, d, h), (x * (w - 0.025) / 2, 0, 0))
    for i in range(num + 1):
        b.box(frame, (w - 0.05, d - 0.02, 0.02), (0, 0, min(0.06 + 0.2 * i, h - 0.02)))
    for i in range(num):
        for j in range(3):
            if b.coin(0.75):
                x = (j - 1) * (w - 0.1) / 3
                for side in (-0.05, 0.05):
                    b.box(shoes, (0.085, 0.25, 0.08), (x + side, 0, 0.08 + 0.2 * i))


def coat_rack(b: Builder) -> None:
    """A pole with hooks on a round foot; a coat hangs on it."""
    frame, coat = b.slot("frame", (*WOODEN, "metal")), b.slot("coat", ("fabric", "leather"))
    h = b.uniform(1.65, 1.8)
    b.cylinder(frame, 0.38, 0.03, (0, 0, 0))
    b.cylinder(frame, 0.045, h - 0.03, (0, 0, 0.03))
    for i, axis in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))):
        b.cylinder(frame, 0.02, 0.36, (0, 0, h - 0.3 - 0.1 * i), axis_quat(axis, 1.5708))
    b.box(coat, (0.09, 0.34, b.uniform(0.7, 0.95)), (0.1, 0, h - 1.12))


def storage_shelf(b: Builder) -> None:
    """An open rack of four posts and boards with boxes on it."""
    frame, board = b.slot("frame", TOUGH), b.slot("board", ("metal", "wood", "metal_diamond_plate"))
    crate = b.slot("crates", ("plastic", "wood", "fabric"))
    w, d, h = b.uniform(0.8, 1.0), b.uniform(0.36, 0.42), b.uniform(1.5, 1.8)
    b.legs(frame, (w, d), 0.035, h)
    for i in range(4):
        z = 0.1 + i * (h - 0.15) / 3
        b.box(board, (w - 0.07, d - 0.01, 0.025), (0, 0, z))
        if i == 3:
            break
        for x in (-1, 1):
            if b.coin(0.8):
                size = (b.uniform(0.25, 0.36), b.uniform(0.24, 0.32), b.uniform(0.16, 0.3))
                b.box(crate, size, (x * 0.21 * w / 0.9, 0, z + 0.025))


def chest(b: Builder) -> None:
    """A box with a lid, for toys or blankets."""
    body, lid = b.slot("body", (*WOODEN, "paint")), b.slot("lid", (*WOODEN, "fabric", "leather"))
    w, d, h = b.uniform(0.7, 0.95), b.uniform(0.38, 0.45), b.uniform(0.38, 0.46)
    b.legs(body, (w - 0.02, d - 0.02), 0.06, 0.04)
    b.box(body, (w - 0.02, d - 0.02, h - 0.09), (0, 0, 0.04))
    b.box(lid, (w, d, 0.05), (0, 0, h - 0.05))
    b.box(b.slot("lock", ("metal",)), (0.07, 0.015, 0.07), (0, d / 2 - 0.002, h - 0.13))


RECIPES = {
    "nightstand": nightstand,
    "dresser": dresser,
    "sideboard": sideboard,
    "tv_stand": tv_stand,
    "wardrobe": wardrobe,
    "bookshelf": bookshelf,
    "shoe_rack": shoe_rack,
    "coat_rack": coat_rack,
    "storage_shelf": storage_shelf,
    "chest": chest,
}
