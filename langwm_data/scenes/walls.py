"""Walls, floors and ceilings of a floor plan, as boxes.

Each room has its own skin of wall, half as thick as the wall between two rooms, so that its colour is
seen from inside that room only. Holes for doors and windows are left out piece by piece.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from langwm_data.scenes.furniture.openings import WALL_THICKNESS
from langwm_data.scenes.plan import HALF_WALL, FloorPlan, Opening, cell_of
from langwm_data.scenes.spec import PartSpec, RoomSpec, SurfaceKind, Vec3

SLAB = 0.1
"""Thickness of floors and ceilings."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A box of the building in world coordinates, before it has an instance and a material."""

    kind: SurfaceKind
    room: str
    low: Vec3
    high: Vec3

    def part(self, slot: int) -> PartSpec:
        """The box as a part made of the material in ``slot``."""
        size = [round(b - a, 4) for a, b in zip(self.low, self.high, strict=True)]
        center = [round((a + b) / 2, 4) for a, b in zip(self.low, self.high, strict=True)]
        return PartSpec(
            shape="box",
            size=(size[0], size[1], size[2]),
            position=(center[0], center[1], center[2]),
            slot=slot,
        )


def room_pieces(plan: FloorPlan, room: RoomSpec, height_m: float) -> list[Piece]:
    """Everything of the building that belongs to one room."""
    x0, y0, x1, y1 = cell_of(room)
    pieces = [
        Piece(kind="floor", room=room.name, low=(x0, y0, -SLAB), high=(x1, y1, 0.0)),
        Piece(kind="ceiling", room=room.name, low=(x0, y0, height_m), high=(x1, y1, height_m + SLAB)),
    ]
    for side in range(4):
        pieces += _wall(plan, room, side, height_m)
    return pieces


def _thickness(plan: FloorPlan, room: RoomSpec, side: int) -> float:
    is_outer = abs(cell_of(room)[side] - plan.extent[side]) < 1e-6
    return WALL_THICKNESS if is_outer else HALF_WALL


def _wall(plan: FloorPlan, room: RoomSpec, side: int, height_m: float) -> list[Piece]:
    """One side (0 west, 1 south, 2 east, 3 north) in pieces around its holes."""
    across = side % 2
    inner = room.rect[side]
    outer = inner + (1 if side >= 2 else -1) * _thickness(plan, room, side)
    depth = (min(inner, outer), max(inner, outer))
    start, end = room.rect[1 - across], room.rect[3 - across]
    if across == 1:  # south and north walls take the corners
        start, end = start - _thickness(plan, room, 0), end + _thickness(plan, room, 2)
    holes = [o for o in plan.openings if _is_in(o, room, side)]
    return [
        Piece(kind="wall", room=room.name, low=low, high=high)
        for low, high in _around_holes((start, end), depth, height_m, holes, across)
    ]


def _is_in(opening: Opening, room: RoomSpec, side: int) -> bool:
    across = side % 2
    if room.name not in opening.rooms or opening.along != ("y" if across == 0 else "x"):
        return False
    return abs(opening.center[across] - cell_of(room)[side]) < 1e-6


def _around_holes(
    span: tuple[float, float],
    depth: tuple[float, float],
    height_m: float,
    holes: Sequence[Opening],
    across: int,
) -> list[tuple[Vec3, Vec3]]:
    """Boxes between, above and below the holes of one wall."""

    def box(a: float, b: float, z0: float, z1: float) -> tuple[Vec3, Vec3]:
        if across == 0:
            return (depth[0], a, z0), (depth[1], b, z1)
        return (a, depth[0], z0), (b, depth[1], z1)

    boxes, at = [], span[0]
    for hole in sorted(holes, key=lambda o: o.interval):
        low, high = hole.interval
        boxes += [box(at, low, 0.0, height_m), box(low, high, hole.z[1], height_m)]
        if hole.z[0] > 0:
            boxes.append(box(low, high, 0.0, hole.z[0]))
        at = high
    boxes.append(box(at, span[1], 0.0, height_m))
    return boxes
