"""What flows into the autoencoder: frames with their objects, and the tensors made of them.

Data only. ``FrameBatch`` is what shards and replay provide; ``MAEBatch`` is what the network reads.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

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


@dataclass(frozen=True, kw_only=True)
class TextTokens:
    """Captions as the frozen text encoder gives them: words, then one pooled token."""

    embed: Float[Tensor, "B L D_text"]
    attend: Bool[Tensor, "B L"]
    """False for padding."""

    def to(self, device: torch.device | str) -> "TextTokens":
        """The same on another device."""
        return TextTokens(embed=self.embed.to(device), attend=self.attend.to(device))


@dataclass(frozen=True, kw_only=True)
class MAEBatch:
    """One batch for the autoencoder, after augmentation."""

    rgb: UInt8[Tensor, "B H W 3"]
    is_hidden: Bool[Tensor, "B H W"]
    """Pixels behind the boxes of hidden objects."""
    depth: Float[Tensor, "B H W"]
    """Metres, 0 where invalid; never hidden."""
    text: TextTokens
    captions: tuple[str, ...]
    is_truncated: Bool[Tensor, " B"]
    """Whether the caption was longer than the language tokens."""
    reward: Float[Tensor, " B"]
    has_reward: Bool[Tensor, " B"]

    def __len__(self) -> int:
        return len(self.captions)

    def to(self, device: torch.device | str) -> "MAEBatch":
        """The same on another device."""
        return replace(self, **{name: getattr(self, name).to(device) for name in (*_TENSORS, "text")})

    def rows(self, which: slice, text: TextTokens | None = None) -> "MAEBatch":
        """Part of the batch, with the same part of ``text``, if given, in place of its own."""
        text = self.text if text is None else text
        part = TextTokens(embed=text.embed[which], attend=text.attend[which])
        tensors = {name: getattr(self, name)[which] for name in _TENSORS}
        return replace(self, **tensors, text=part, captions=self.captions[which])


_TENSORS = ("rgb", "is_hidden", "depth", "is_truncated", "reward", "has_reward")
