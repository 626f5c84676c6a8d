"""The state of one room while it is being furnished, and what may still be put where.

Nothing is placed that would lie through a wall or another thing, stand in a doorway or before a
window, or cut a part of the room off from its doorways.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.style import HomeStyle
from langwm_data.scenes.furniture import Model
from langwm_data.scenes.geometry import rects_overlap
from langwm_data.scenes.spec import Rect, RoomSpec

Wall = Literal["south", "east", "north", "west"]
WALLS: tuple[Wall, ...] = ("south", "east", "north", "west")
WALL_YAW = {"south": 0.0, "east": math.pi / 2, "north": math.pi, "west": -math.pi / 2}
"""Yaw of a piece that has its back to the wall and faces into the room."""

GAP = 0.015
"""Least horizontal distance between two pieces."""
WALL_GAP = 0.01
"""Distance of a piece from the wall behind it."""
PASSAGE_RADIUS = 0.26
"""Half the width kept free for the robot: its radius and what a body and a grid need on top."""
FLAT_M = 0.02
"""What is lower, such as a rug, is walked and driven over."""
_CELL = 0.1
_REST_M = 0.004
"""How deep what lies on a piece may reach into it before it settles."""
_TUCKS = {("chair", "dining_table"), ("chair", "desk"), ("office_chair", "desk")}
"""Pairs of which the first may stand under the second; their parts decide."""
_ROW = {"kitchen_cabinet", "kitchen_sink", "stove", "dishwasher", "fridge", "wall_cabinet", "range_hood"}
"""Pieces that stand side by side without a gap."""


ZoneKind = Literal["doorway", "window", "front"]
ALL_ZONES: tuple[ZoneKind, ...] = ("doorway", "window", "front")


@dataclass(frozen=True, kw_only=True)
class Zone:
    """A volume that furniture keeps out of: before a doorway, a window, or a piece that is used."""

    kind: ZoneKind
    rect: Rect
    z: tuple[float, float]


def front_rect(piece: Placement, depth_m: float) -> Rect:
    """The strip of floor before a piece that stands square to the walls."""
    w, d, _ = piece.model.size
    a, b = piece.local(-w / 2, d / 2 + 0.001), piece.local(w / 2, d / 2 + depth_m)
    return (min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1]))


class RoomState:
    """One room: what stands in it, what must stay free, and the generator of its furnishing."""

    def __init__(self, room: RoomSpec, height_m: float, style: HomeStyle, rng: np.random.Generator) -> None:
        self.room = room
        self.rect = room.rect
        self.height_m = height_m
        self.style = style
        self.rng = rng
        self.placements: list[Placement] = []
        self.zones: list[Zone] = []
        self.entries: list[tuple[float, float]] = []
        """A point just inside each doorway."""

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y."""
        return (self.rect[2] - self.rect[0], self.rect[3] - self.rect[1])

    @property
    def center(self) -> tuple[float, float]:
        """The middle of the room."""
        return ((self.rect[0] + self.rect[2]) / 2, (self.rect[1] + self.rect[3]) / 2)

    def coin(self, probability: float) -> bool:
        """True with ``probability``, raised or lowered by how full the home's style is."""
        return bool(self.rng.random() < probability * self.style.density)

    def shuffled(self, items: Iterable[str]) -> list[str]:
        """The items in random order."""
        listed = list(items)
        return [listed[i] for i in self.rng.permutation(len(listed))]

    def of_category(self, category: str) -> list[Placement]:
        """What has been placed of one category."""
        return [p for p in self.placements if p.model.category == category]

    def stand(
        self,
        model: Model,
        xy: tuple[float, float],
        yaw_rad: float = 0.0,
        *,
        z: float = 0.0,
        on: Placement | None = None,
    ) -> Placement:
        """A placement in this room, not yet added: at a height, or on another piece."""
        z = (z if on is None else on.surface) + model.elevation_m
        position = (round(xy[0], 4), round(xy[1], 4), round(z, 4))
        return Placement(model=model, room=self.room.name, position=position, yaw_rad=yaw_rad, support=on)

    def wall_span(self, wall: Wall) -> tuple[float, float]:
        """From where to where a wall runs, along x or y."""
        axis = 0 if wall in ("south", "north") else 1
        return (self.rect[axis], self.rect[axis + 2])

    def against(self, model: Model, wall: Wall, along: float, *, gap: float, z: float) -> Placement:
        """A placement with its back to a wall, its middle at ``along``."""
        offset = model.size[1] / 2 + gap
        x0, y0, x1, y1 = self.rect
        xy = {
            "south": (along, y0 + offset),
            "north": (along, y1 - offset),
            "west": (x0 + offset, along),
            "east": (x1 - offset, along),
        }[wall]
        return self.stand(model, xy, WALL_YAW[wall], z=z)

    def fits(self, new: Placement, *, zones: Sequence[ZoneKind] = ALL_ZONES) -> bool:
        """Whether a piece is inside the room, out of zones of these kinds, and clear of all placed."""
        x0, y0, x1, y1 = new.footprint
        low_z, high_z = new.bounds[:, 2]
        e = 1e-6
        if x0 < self.rect[0] - e or y0 < self.rect[1] - e or x1 > self.rect[2] + e or y1 > self.rect[3] + e:
            return False
        if low_z < -e or high_z > self.height_m + e:
            return False
        if any(
            low_z < z.z[1] - e and z.z[0] < high_z - e and rects_overlap(new.footprint, z.rect)
            for z in self.zones
            if z.kind in zones
        ):
            return False
        return not any(self._collide(new, other) for other in self.placements)

    @staticmethod
    def _collide(new: Placement, other: Placement) -> bool:
        e = 1e-5
        if new.bounds[0, 2] >= other.top - e or other.bounds[0, 2] >= new.top - e:
            return False
        if new.support is other:
            return bool(new.boxes.overlap(other.boxes, tolerance_m=_REST_M).any())
        if (new.model.category, other.model.category) in _TUCKS:
            return bool(new.boxes.overlap(other.boxes, tolerance_m=-0.004).any())
        gap = 0.0 if {new.model.category, other.model.category} <= _ROW else GAP
        return rects_overlap(new.footprint, other.footprint, gap)

    def add(self, *group: Placement, zones: Sequence[ZoneKind] = ALL_ZONES) -> bool:
        """Place all of a group, or nothing if one does not fit or a way would be blocked."""
        before = len(self.placements)
        for new in group:
            if not self.fits(new, zones=zones):
                del self.placements[before:]
                return False
            self.placements.append(new)
        if any(p.bounds[0, 2] < 0.5 for p in group) and not self.is_passable():
            del self.placements[before:]
            return False
        return True

    def is_passable(self) -> bool:
        """Whether one open area joins all doorways and leaves a fair part of the room to walk in."""
        x0, y0, x1, y1 = self.rect
        xs, ys = np.arange(x0 + _CELL / 2, x1, _CELL), np.arange(y0 + _CELL / 2, y1, _CELL)
        r = PASSAGE_RADIUS
        free = np.ones((len(xs), len(ys)), bool)
        free[(xs < x0 + r) | (xs > x1 - r)] = False
        free[:, (ys < y0 + r) | (ys > y1 - r)] = False
        for p in self.placements:
            if p.bounds[0, 2] > 0.5 or p.top < FLAT_M:
                continue
            a0, b0, a1, b1 = p.footprint
            free[np.ix_((xs > a0 - r) & (xs < a1 + r), (ys > b0 - r) & (ys < b1 + r))] = False
        labels: NDArray[np.int32] = ndimage.label(free)[0]  # pyright: ignore
        found = {int(labels[self._cell(entry, labels.shape)]) for entry in self.entries}
        if len(found) != 1 or 0 in found:
            return False
        return (labels == found.pop()).sum() >= self.style.min_free_fraction * free.size

    def _cell(self, xy: tuple[float, float], shape: tuple[int, ...]) -> tuple[int, int]:
        i = int((xy[0] - self.rect[0]) / _CELL)
        j = int((xy[1] - self.rect[1]) / _CELL)
        return (min(max(i, 0), shape[0] - 1), min(max(j, 0), shape[1] - 1))

    def wall_placements(self, model: Model, *, prefer: str = "any", z: float = 0.0) -> list[Placement]:
        """All ways to put a piece against walls, best first, before any check of what is in the way.

        Args:
            model: The piece.
            prefer: ``center`` of a wall, ``corner`` of the room, or ``any``.
            z: Height above the floor.
        """
        scored = []
        half = model.size[0] / 2 + GAP
        for wall in WALLS:
            low, high = self.wall_span(wall)
            low, high = low + half, high - half
            if high < low:
                continue
            middle = (low + high) / 2
            for along in np.linspace(low, high, max(2, int((high - low) / 0.1) + 1)):
                to_middle = abs(along - middle) / max(high - low, 0.1)
                score = {"center": to_middle, "corner": 0.5 - to_middle, "any": 0.0}[prefer]
                noise = 0.3 * float(self.rng.random())
                scored.append((score + noise, wall, float(along)))
        scored.sort()
        return [self.against(model, wall, along, gap=WALL_GAP, z=z) for _, wall, along in scored]

    def put_at_wall(
        self,
        category: str,
        *,
        prefer: str = "any",
        z: float = 0.0,
        front_m: float = 0.0,
    ) -> Placement | None:
        """Put a piece of a category against some wall where it fits, if there is any such place.

        Args:
            category: What to put.
            prefer: As for ``wall_placements``.
            z: Height above the floor.
            front_m: How much floor before the piece must be and stay free.
        """
        for model in self.style.models(self.rng, category):
            for placement in self.wall_placements(model, prefer=prefer, z=z):
                if self.is_front_free(placement, front_m) and self.add(placement):
                    self.keep_front_free(placement, front_m)
                    return placement
        return None

    def is_at_wall(self, piece: Placement) -> bool:
        """Whether a piece has its back to a wall."""
        x, y = piece.local(0.0, -piece.model.size[1] / 2 - 2 * WALL_GAP)
        return not (self.rect[0] < x < self.rect[2] and self.rect[1] < y < self.rect[3])

    def is_front_free(self, piece: Placement, depth_m: float) -> bool:
        """Whether nothing stands on the floor before a piece."""
        if depth_m <= 0:
            return True
        front = front_rect(piece, depth_m)
        return not any(p.top > FLAT_M and rects_overlap(front, p.footprint) for p in self.placements)

    def keep_front_free(self, piece: Placement, depth_m: float) -> None:
        """Let nothing but a rug lie on the floor before a piece."""
        if depth_m > 0:
            self.zones.append(Zone(kind="front", rect=front_rect(piece, depth_m), z=(FLAT_M, 2.0)))
