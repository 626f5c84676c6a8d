"""What callers supply to the autoencoder as a library: frames, masks, captions, and whether they fit."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from pretrain.batch import TextTokens
from pretrain.config import MAEConfig


def boxes_mask(
    boxes_xyxy: Sequence[Sequence[tuple[float, float, float, float]]], height: int, width: int
) -> Bool[Tensor, "B H W"]:
    """The pixels inside the boxes of each frame: edges in pixels, right and bottom exclusive."""
    mask = torch.zeros(len(boxes_xyxy), height, width, dtype=torch.bool)
    for number, boxes in enumerate(boxes_xyxy):
        for x1, y1, x2, y2 in boxes:
            left, top = max(math.floor(x1), 0), max(math.floor(y1), 0)
            mask[number, top : max(math.ceil(y2), 0), left : max(math.ceil(x2), 0)] = True
    return mask


def as_tensor(value: Tensor | np.ndarray, device: torch.device) -> Tensor:
    """A tensor as it is, or what an array holds, on ``device``."""
    if not isinstance(value, np.ndarray):
        return value
    # A copy: PyTorch takes no array that runs backwards, and warns of one that cannot be written to.
    return torch.from_numpy(np.array(value, order="C")).to(device)


def check_frames(rgb: Tensor, config: MAEConfig) -> None:
    """Refuse what is no batch of frames.

    Raises:
        ValueError: If the type is not that of 8-bit colours, or the size another than the model's.
    """
    kind = rgb.dtype if isinstance(rgb, Tensor) else type(rgb).__name__
    if kind != torch.uint8:
        raise ValueError(f"frames of type {kind}; this model reads torch.uint8, colours from 0 to 255")
    expected = (config.height, config.width, 3)
    if tuple(rgb.shape[1:]) != expected:
        raise ValueError(f"frames of shape {tuple(rgb.shape[1:])}; this model reads {expected}, in a batch")


def check_masks(
    num_frames: int, config: MAEConfig, is_hidden: Tensor | None, is_dropped: Tensor | None
) -> None:
    """Refuse masks that do not fit the frames.

    Raises:
        ValueError: If one is of another type or shape, or another number of tokens is dropped in some frame,
            or all.
    """
    _check("is_hidden", is_hidden, (num_frames, config.height, config.width), torch.bool)
    _check("is_dropped", is_dropped, (num_frames, config.num_patches), torch.bool)
    counts = set() if is_dropped is None else set(is_dropped.sum(dim=1).tolist())
    if len(counts) > 1 or counts == {config.num_patches}:
        raise ValueError(
            f"is_dropped leaves out {sorted(counts)} of {config.num_patches} tokens;"
            " allowed: as many in every frame, and not all"
        )


def check_text(num_frames: int, null_embed: Tensor, text: TextTokens | None) -> None:
    """Refuse captions that another text encoder embedded, or of another number of frames.

    Raises:
        ValueError: If the shape is another than that of the model's empty caption, once for each frame.
    """
    if text is not None:
        _check("text.embed", text.embed, (num_frames, *null_embed.shape[1:]), torch.float32)
        _check("text.attend", text.attend, (num_frames, null_embed.shape[1]), torch.bool)


def _check(name: str, value: Tensor | None, shape: tuple[int, ...], dtype: torch.dtype) -> None:
    if value is not None and (tuple(value.shape), value.dtype) != (shape, dtype):
        raise ValueError(
            f"{name} is {value.dtype} {tuple(value.shape)}; for these frames and this model, {dtype} {shape}"
        )
