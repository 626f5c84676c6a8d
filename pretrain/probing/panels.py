"""Pictures of single frames of a probe: what was hidden, what was filled in with each caption, the truth."""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from pretrain.batch import MAEBatch
from pretrain.pictures import depth_to_rgb, hide_pixels

MIN_SHARE = 0.06
"""Of the picture behind the box: smaller ones show nothing."""
_NOT_INVALID_M = 1e-3


def shown_rows(batch: MAEBatch, count: int) -> list[int]:
    """Frames whose box is large enough to see, evenly spaced, whatever came out for them."""
    large = torch.nonzero(batch.is_hidden.float().mean(dim=(1, 2)) > MIN_SHARE).flatten()
    places = np.linspace(0, len(large) - 1, min(count, len(large))).round().astype(int)
    return large[torch.from_numpy(places)].tolist()


def panel_images(
    batch: MAEBatch, row: int, depth_of: Mapping[str, Float[Tensor, "H W"]], max_depth_m: float
) -> dict[str, NDArray[np.uint8]]:
    """Input, masked input, the depth predicted with each caption, and the truth, by name.

    Args:
        batch: On the CPU.
        row: The frame.
        depth_of: Metres, by the name of the caption.
        max_depth_m: End of the colour scale.
    """
    rgb, is_hidden = batch.rgb[row].numpy(), batch.is_hidden[row].numpy()
    images = {"input": rgb, "masked": hide_pixels(rgb, is_hidden)}
    for name, depth in depth_of.items():
        predicted = np.maximum(depth.numpy(), _NOT_INVALID_M)
        images[name] = depth_to_rgb(predicted, max_depth_m)
    return images | {"truth": depth_to_rgb(batch.depth[row].numpy(), max_depth_m)}
