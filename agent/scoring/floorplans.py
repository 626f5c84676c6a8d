"""A floor seen from above with the ways that were driven on it, as pictures of pixels."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from agent.figures import FLOOR, FURNITURE, WALL, Walk
from langwm_data.scenes.navigation import floor_plan
from langwm_data.scenes.spec import SceneSpec
from pretrain.figures import ACCENT, WARM

Picture = UInt8[np.ndarray, "H W 3"]

MARGIN_PX = 12
GREY = "#8a94a3"
_SHIFT = 4
"""OpenCV takes coordinates in sixteenths of a pixel."""


class FloorPicture:
    """The plan of a scene, x to the right and y up, to draw walks on.

    Args:
        scene: What is on the floor.
        height_px: Of the pictures; the width follows.
    """

    def __init__(self, scene: SceneSpec, height_px: int) -> None:
        shapes = [(kind, np.asarray(polygon)) for kind, polygon in floor_plan(scene)]
        corners = np.concatenate([polygon for _, polygon in shapes])
        self._low, high = corners.min(axis=0), corners.max(axis=0)
        size = high - self._low
        self._scale = (height_px - 2 * MARGIN_PX) / float(size[1])
        width_px = int(np.ceil(size[0] * self._scale)) + 2 * MARGIN_PX
        self._height_px = height_px
        self.empty: Picture = np.full((height_px, width_px, 3), 255, np.uint8)
        """Without walks."""
        for kind, polygon in shapes:
            color = _rgb({"floor": FLOOR, "wall": WALL}.get(kind, FURNITURE))
            cv2.fillPoly(self.empty, [self._pixels(polygon)], color, cv2.LINE_AA, _SHIFT)

    def draw(
        self, walks: Sequence[Walk], radius_m: float, best: Float[np.ndarray, "N 2"] | None = None
    ) -> Picture:
        """The floor with walks: a dot where one starts, a ring around its goal, blue where it arrives.

        Args:
            walks: What was driven.
            radius_m: Of the rings.
            best: The shortest way, drawn below the walks in grey.
        """
        picture = self.empty.copy()
        if best is not None:
            cv2.polylines(picture, [self._pixels(best)], False, _rgb(GREY), 1, cv2.LINE_AA, _SHIFT)
        for walk in walks:
            color = _rgb(ACCENT if walk.is_success else WARM)
            way = self._pixels(walk.positions)
            cv2.polylines(picture, [way], False, color, 2, cv2.LINE_AA, _SHIFT)
            dot, goal = way[0].tolist(), self._pixels(np.array([walk.goal]))[0].tolist()
            cv2.circle(picture, dot, 4 << _SHIFT, color, -1, cv2.LINE_AA, _SHIFT)
            ring = round(radius_m * self._scale * (1 << _SHIFT))
            cv2.circle(picture, goal, ring, color, 1, cv2.LINE_AA, _SHIFT)
        return picture

    def _pixels(self, points: Float[np.ndarray, "N 2"]) -> np.ndarray:
        x = (points[:, 0] - self._low[0]) * self._scale + MARGIN_PX
        y = self._height_px - MARGIN_PX - (points[:, 1] - self._low[1]) * self._scale
        return np.round(np.stack([x, y], axis=1) * (1 << _SHIFT)).astype(np.int32)


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue
