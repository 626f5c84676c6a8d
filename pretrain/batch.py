"""The tensors that the autoencoder reads. Data only."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor


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
