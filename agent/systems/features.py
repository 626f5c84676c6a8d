"""Features of a frozen encoder, computed once per frame."""

import hashlib
from collections import OrderedDict
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, UInt8
from torch import Tensor


@runtime_checkable
class Encoder(Protocol):
    """Anything that makes tokens of pictures, such as ``pretrain.LanguageGroundedMAE``."""

    def encode(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B N D"]:
        """Tokens of each frame, the same for the same frame every time."""
        ...


class TokenCache:
    """Encodes frames with an encoder that no longer changes, and remembers the tokens.

    Replay draws the same frames again and again. Each is encoded on its own, whatever it was drawn
    together with, so that a resumed run, whose cache is empty, computes the same numbers.

    Args:
        encoder: Must not be trained while this is in use.
        capacity_mib: Memory for tokens; the least recently used go first.
        dtype: In which tokens are remembered, and to whose precision they are rounded.
    """

    def __init__(self, encoder: Encoder, capacity_mib: int, dtype: torch.dtype = torch.half) -> None:
        self._encoder = encoder
        self._dtype = dtype
        self._capacity_bytes = capacity_mib * 2**20
        self.capacity: int | None = None
        """Frames remembered at most; known once one has been encoded."""
        self._tokens: OrderedDict[bytes, Tensor] = OrderedDict()

    @property
    def num_frames(self) -> int:
        """Frames remembered now."""
        return len(self._tokens)

    def encode(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B N V"]:
        """Tokens of frames; as the encoder gives them, rounded."""
        return torch.stack([self._encode_one(frame).float() for frame in rgb])

    def _encode_one(self, frame: UInt8[Tensor, "H W 3"]) -> Tensor:
        key = hashlib.blake2b(frame.numpy(force=True).tobytes(), digest_size=16).digest()
        tokens = self._tokens.pop(key, None)
        if tokens is None:
            with torch.no_grad(), torch.autocast(frame.device.type, enabled=False):
                tokens = self._encoder.encode(frame[None])[0].to(self._dtype)
        if self.capacity is None:
            self.capacity = max(1, self._capacity_bytes // tokens.nbytes)
        self._tokens[key] = tokens
        if len(self._tokens) > self.capacity:
            self._tokens.popitem(last=False)
        return tokens
