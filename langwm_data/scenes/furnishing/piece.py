"""A model that stands somewhere: where its bounds, its solids and its top are in the world."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.furniture import Model
from langwm_data.scenes.geometry import Boxes, yaw_quat
from langwm_data.scenes.spec import Quat, Rect, Vec3


@dataclass(frozen=True, kw_only=True)
class Placement:
    """A model that stands somewhere."""

    model: Model
    room: str
    position: Vec3
    yaw_rad: float = 0.0
    is_fixed: bool = True
    support: "Placement | None" = None
    """What it lies on, if its solids may be within the bounds of that."""

    @property
    def orientation(self) -> Quat:
        """Quaternion x, y, z, w."""
        return yaw_quat(self.yaw_rad)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3): the axis-aligned box around it."""
        c, s = abs(math.cos(self.yaw_rad)), abs(math.sin(self.yaw_rad))
        w, d, h = self.model.size
        reach = np.array([(w * c + d * s) / 2, (w * s + d * c) / 2])
        xy = np.array(self.position[:2])
        z = self.position[2]
        return np.array([[*(xy - reach), z], [*(xy + reach), z + h]]).round(6)

    @property
    def footprint(self) -> Rect:
        """The box seen from above."""
        (x0, y0, _), (x1, y1, _) = self.bounds.tolist()
        return (x0, y0, x1, y1)

    @cached_property
    def boxes(self) -> Boxes:
        """Its parts in the world."""
        return Boxes.of_parts((self.position, self.orientation, part) for part in self.model.parts)

    @property
    def top(self) -> float:
        """Height of its highest point."""
        return float(self.bounds[1, 2])

    @property
    def surface(self) -> float:
        """Height at which things are put on it."""
        height = self.model.size[2] if self.model.top is None else self.model.top.height
        return round(self.position[2] + height, 6)

    def local(self, x: float, y: float) -> tuple[float, float]:
        """A point of the model's own frame in the world."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (self.position[0] + c * x - s * y, self.position[1] + s * x + c * y)
