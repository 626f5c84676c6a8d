"""Where in the encoder image tokens look at words. The decoder never sees a word.

Owns the recording of attention; pictures of it stand in ``figures``.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Bool, Float, UInt8
from torch import Tensor, nn

from pretrain.batch import TextTokens
from pretrain.mae import LanguageGroundedMAE, evaluating
from pretrain.transformer import Attention, Transformer


@dataclass(frozen=True, kw_only=True)
class WordAttention:
    """How much image tokens look at language tokens: the mean over heads, for each layer of the encoder.

    What is missing to 1 goes to image tokens and CLS.
    """

    cells: Float[np.ndarray, "layers rows columns L"]
    """From each cell of the grid of image tokens."""
    cls: Float[np.ndarray, "layers L"]
    """From the CLS token."""

    def share(self, is_inside: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, " layers"]:
        """The share that all words together have of the attention of some cells; not a number for none."""
        inside = self.cells[:, is_inside].sum(axis=-1)
        return inside.mean(axis=1) if is_inside.any() else np.full(len(self.cells), np.nan)


@torch.no_grad()
def attend_to_words(
    mae: LanguageGroundedMAE,
    rgb: UInt8[Tensor, "B H W 3"],
    is_hidden: Bool[Tensor, "B H W"],
    text: TextTokens,
) -> list[WordAttention]:
    """The attention of frames whose objects are hidden; no token is dropped and dropout is off.

    Args:
        mae: Its mode is kept.
        rgb: Frames.
        is_hidden: Pixels behind boxes.
        text: What is said of them.
    """
    with evaluating(mae), record_attention(mae.encoder) as layers:
        visual = mae.patchify(rgb.to(mae.device), is_hidden.to(mae.device))
        mae.encode_tokens(visual, text.to(mae.device))
    weights = torch.stack(layers, dim=1).mean(dim=2).float().cpu().numpy()
    rows, columns = mae.config.grid
    first_word = 1 + rows * columns
    cells = rearrange(weights[:, :, 1:first_word, first_word:], "b k (r c) l -> b k r c l", r=rows)
    cls = weights[:, :, 0, first_word:]
    return [WordAttention(cells=cells[i], cls=cls[i]) for i in range(len(weights))]


@contextmanager
def record_attention(transformer: Transformer) -> Iterator[list[Float[Tensor, "B heads N N"]]]:
    """Within the block, the weights of every layer of the transformer are added to the list, in order."""
    layers: list[Tensor] = []

    def record(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        assert isinstance(module, Attention)
        layers.append(module.weights(*inputs))

    handles = [m.register_forward_pre_hook(record) for m in transformer.modules() if isinstance(m, Attention)]
    try:
        yield layers
    finally:
        for handle in handles:
            handle.remove()


def cells_inside(
    is_hidden: Bool[np.ndarray, "H W"], grid: tuple[int, int], least: float = 0.5
) -> Bool[np.ndarray, "rows columns"]:
    """Cells of the grid of which at least a share ``least`` is hidden."""
    parts = rearrange(is_hidden, "(r y) (c x) -> r c (y x)", r=grid[0], c=grid[1])
    return parts.mean(axis=-1) >= least
