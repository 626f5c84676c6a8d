"""What a floor plan is: rooms, and the openings between them and to the outside.

Pure data and what follows from it. How rooms are laid out stands in ``layouts``, where doors and
windows go in ``openings``.
"""

from dataclasses import dataclass
from typing import Literal

from langwm_data.scenes.furniture.openings import WALL_THICKNESS
from langwm_data.scenes.spec import Rect, RoomSpec

HALF_WALL = WALL_THICKNESS / 2
Along = Literal["x", "y"]


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A rectangular hole in the walls between two rooms, or between a room and outside."""

    kind: Literal["door", "passage", "entrance", "window"]
    rooms: tuple[str, ...]
    """One room for windows and entrances, else two."""
    model: str
    """Model of what fills the hole: a window or a door frame."""
    along: Along
    """The direction in which the wall runs."""
    center: tuple[float, float]
    """On the middle plane of the wall."""
    width: float
    """Of the hole."""
    clear_width: float
    """Between the linings; what is left to pass through."""
    z: tuple[float, float]
    """From sill to lintel."""

    @property
    def interval(self) -> tuple[float, float]:
        """The hole along the wall."""
        middle = self.center[0 if self.along == "x" else 1]
        return (middle - self.width / 2, middle + self.width / 2)


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """Rooms and openings of one floor."""

    rooms: tuple[RoomSpec, ...]
    openings: tuple[Opening, ...]
    extent: Rect
    """Outer edge of the cells; the middle plane of the outer walls."""


def cell_of(room: RoomSpec) -> Rect:
    """The room with half of its walls."""
    x0, y0, x1, y1 = room.rect
    return (x0 - HALF_WALL, y0 - HALF_WALL, x1 + HALF_WALL, y1 + HALF_WALL)


def shared_wall(a: Rect, b: Rect) -> tuple[Along, float, tuple[float, float]] | None:
    """Direction of the wall between two cells, where it stands, and from where to where it runs."""
    for axis, along in ((0, "y"), (1, "x")):
        for edge, other in ((a[axis + 2], b[axis]), (a[axis], b[axis + 2])):
            low = max(a[1 - axis], b[1 - axis]) + HALF_WALL
            high = min(a[3 - axis], b[3 - axis]) - HALF_WALL
            if abs(edge - other) < 1e-6 and high > low:
                return ("x" if along == "x" else "y", edge, (low, high))
    return None
