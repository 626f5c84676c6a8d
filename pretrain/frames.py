"""Frames as they were seen, with their objects: what shards, environments and replay hand over.

Data only, and without torch, so that processes that only simulate need not load it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from langwm_data.scenes.taxonomy import phrase


@dataclass(frozen=True, kw_only=True)
class FrameObject:
    """One object worth a caption, as seen in one frame. Surfaces and tiny objects are left out."""

    category: str
    bbox_xyxy: tuple[float, float, float, float]
    """Pixel edges: x1 <= x < x2."""
    center_x: float
    """Of the object's mask, in pixels."""
    distance_m: float
    """Mean z-depth over the mask."""
    phrase: str = ""
    """The noun for it; empty for that of its category."""
    instance: int = 0
    """Its id in the frame's instance mask, where there is one."""
    model: str = ""
    """Name of the furniture model, where it is known."""

    @property
    def noun(self) -> str:
        """What captions call it."""
        return self.phrase or phrase(self.category)


@dataclass(frozen=True, kw_only=True)
class FrameBatch:
    """Frames as they were seen, before anything is augmented or hidden."""

    rgb: UInt8[np.ndarray, "B H W 3"]
    depth: Float[np.ndarray, "B H W"]
    """Metres, 0 where invalid."""
    objects: list[list[FrameObject]]
    """Per frame, the objects that may be hidden."""
    reward: Float[np.ndarray, " B"]
    has_reward: Bool[np.ndarray, " B"]
    """False for frames that nobody acted in: rendered datasets."""

    def __len__(self) -> int:
        return len(self.rgb)
