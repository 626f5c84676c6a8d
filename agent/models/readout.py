"""How a number is read from what a head gives, and how the head is taught a number.

Owns no weights: a head is a perceptron with as many outputs as its readout wants.
"""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.config import MLPConfig
from agent.models.distributions import symexp
from agent.models.nets import make_mlp
from pretrain.losses import symlog

NUM_BINS = 255
"""Of a two-hot head. Source: DreamerV3."""
LARGEST_EXPONENT = 20.0
"""The bins reach from -(e^20 - 1) to e^20 - 1. Source: DreamerV3."""


class Readout(nn.Module, ABC):
    """The meaning of a head's outputs."""

    num_outputs: int

    @abstractmethod
    def value(self, raw: Float[Tensor, "*B O"]) -> Float[Tensor, "*B"]:
        """The number that the outputs stand for, in its own units."""

    @abstractmethod
    def loss(self, raw: Float[Tensor, "*B O"], target: Float[Tensor, "*B"]) -> Float[Tensor, "*B"]:
        """Negative log likelihood of ``target``, without constants; each on its own."""


class PointReadout(Readout):
    """The one output is the number, or its symlog; taught by half the squared error."""

    num_outputs = 1

    def __init__(self, *, is_symlog: bool = False) -> None:
        super().__init__()
        self._is_symlog = is_symlog

    def value(self, raw: Float[Tensor, "*B 1"]) -> Float[Tensor, "*B"]:
        """See ``Readout.value``."""
        number = raw.squeeze(-1).float()
        return symexp(number) if self._is_symlog else number

    def loss(self, raw: Float[Tensor, "*B 1"], target: Float[Tensor, "*B"]) -> Float[Tensor, "*B"]:
        """See ``Readout.loss``."""
        return half_square(raw.squeeze(-1) - (symlog(target) if self._is_symlog else target))


class TwoHotReadout(Readout):
    """The outputs are logits of bins, close together near zero; the number is the mean over them.

    Taught by the cross-entropy with the two bins around the target, weighted so that their mean is it.

    Source: DreamerV3.
    """

    num_outputs = NUM_BINS
    bins: Tensor

    def __init__(self) -> None:
        super().__init__()
        below = -symexp(torch.linspace(LARGEST_EXPONENT, 0, NUM_BINS // 2 + 1))
        self.register_buffer("bins", torch.cat([below, -below[:-1].flip(0)]), persistent=False)

    def value(self, raw: Float[Tensor, "*B O"]) -> Float[Tensor, "*B"]:
        """See ``Readout.value``.

        Bins of equal size and opposite sign are added first: so equal logits give exactly zero.
        """
        weighted = raw.float().softmax(-1) * self.bins
        middle = NUM_BINS // 2
        below, above = weighted[..., :middle].flip(-1), weighted[..., middle + 1 :]
        return (below + above).sum(-1) + weighted[..., middle]

    def loss(self, raw: Float[Tensor, "*B O"], target: Float[Tensor, "*B"]) -> Float[Tensor, "*B"]:
        """See ``Readout.loss``."""
        log_p = raw.float().log_softmax(-1)
        above = torch.bucketize(target.contiguous(), self.bins).clamp(1, NUM_BINS - 1)
        low, high = self.bins[above - 1], self.bins[above]
        share = ((target - low) / (high - low)).clamp(0, 1)
        log_low, log_high = (log_p.gather(-1, i[..., None]).squeeze(-1) for i in (above - 1, above))
        return -(1 - share) * log_low - share * log_high


def make_readout(transform: str) -> Readout:
    """The readout of that name in the config: ``identity``, ``symlog`` or ``twohot``."""
    return TwoHotReadout() if transform == "twohot" else PointReadout(is_symlog=transform == "symlog")


def make_head(feat_dim: int, config: MLPConfig, readout: Readout) -> nn.Sequential:
    """A perceptron for ``readout``; one with bins begins by predicting zero. Source: DreamerV3."""
    head = make_mlp(feat_dim, config.units, config.layers, readout.num_outputs)
    if readout.num_outputs > 1:
        nn.init.zeros_(head[-1].weight)  # pyright: ignore[reportArgumentType]
    return head


def half_square(error: Tensor) -> Tensor:
    """Negative log density of a unit normal, without its constant."""
    return 0.5 * error.square()
