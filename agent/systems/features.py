"""Features of a frozen MAE, computed once per frame."""

import hashlib
from collections import OrderedDict

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from pretrain.mae import LanguageGroundedMAE


class TokenCache:
    """Encodes frames with a MAE that no longer changes, and remembers the tokens in half precision.

    Replay draws the same frames again and again. Each is encoded on its own, whatever it was drawn
    together with, so that a resumed run, whose cache is empty, computes the same numbers.

    Args:
        mae: Must not be trained while this is in use.
        capacity_mib: Memory for tokens; the least recently used go first.
    """

    def __init__(self, mae: LanguageGroundedMAE, capacity_mib: int) -> None:
        self._mae = mae
        frame_bytes = 2 * (1 + mae.config.num_patches) * mae.config.dim
        self.capacity = max(1, capacity_mib * 2**20 // frame_bytes)
        """Frames remembered at most."""
        self._tokens: OrderedDict[bytes, Tensor] = OrderedDict()

    def __len__(self) -> int:
        return len(self._tokens)

    def encode(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B N V"]:
        """Tokens of frames; as ``LanguageGroundedMAE.encode``, rounded to half precision."""
        return torch.stack([self._encode_one(frame).float() for frame in rgb])

    def _encode_one(self, frame: UInt8[Tensor, "H W 3"]) -> Tensor:
        key = hashlib.blake2b(frame.numpy(force=True).tobytes(), digest_size=16).digest()
        tokens = self._tokens.pop(key, None)
        if tokens is None:
            with torch.autocast(self._mae.device.type, enabled=False):
                tokens = self._mae.encode(frame[None])[0].half()
        self._tokens[key] = tokens
        if len(self._tokens) > self.capacity:
            self._tokens.popitem(last=False)
        return tokens
