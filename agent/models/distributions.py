"""Distributions of the world model and the actor: straight-through categoricals, truncated normal.

Pure functions and one frozen class of tensors; every sample takes a ``torch.Generator``.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

SAMPLE_MARGIN = 1e-6
"""Samples of the truncated normal stay this far from its limits. Source: DreamerV2."""


def sample_straight_through(
    logit: Float[Tensor, "*B S K"], generator: torch.Generator
) -> Float[Tensor, "*B S K"]:
    """One-hot samples whose gradient is that of the probabilities.

    Drawn by inverting the distribution function: one random number per categorical.

    Source: DreamerV2.
    """
    probability = logit.softmax(-1)
    cumulative = probability.detach().cumsum(-1)
    uniform = torch.rand((*logit.shape[:-1], 1), generator=generator, device=logit.device)
    index = torch.searchsorted(cumulative, uniform * cumulative[..., -1:], right=True)
    index = index.clamp(max=logit.shape[-1] - 1)
    one_hot = torch.zeros_like(probability).scatter_(-1, index, 1.0)
    return one_hot + probability - probability.detach()


def mix_uniform(logit: Float[Tensor, "*B S K"], share: float) -> Float[Tensor, "*B S K"]:
    """Logits of a mixture with the uniform distribution, which keeps every class possible.

    Source: DreamerV3 (unimix).
    """
    if share == 0:
        return logit
    return ((1 - share) * logit.softmax(-1) + share / logit.shape[-1]).log()


def categorical_kl(p: Float[Tensor, "*B S K"], q: Float[Tensor, "*B S K"]) -> Float[Tensor, "*B"]:
    """KL(p || q) of two sets of S independent categoricals given as logits, in nats, summed over S."""
    log_p, log_q = p.log_softmax(-1), q.log_softmax(-1)
    return (log_p.exp() * (log_p - log_q)).sum((-2, -1))


def categorical_entropy(logit: Float[Tensor, "*B S K"]) -> Float[Tensor, "*B"]:
    """Entropy of S independent categoricals given as logits, in nats, summed over S."""
    log_p = logit.log_softmax(-1)
    return -(log_p.exp() * log_p).sum((-2, -1))


def symexp(x: Tensor) -> Tensor:
    """Inverse of ``pretrain.losses.symlog``."""
    return torch.sign(x) * torch.expm1(x.abs())


@dataclass(frozen=True)
class TruncatedNormal:
    """Independent normals cut off at -1 and 1, one per action dimension; ``loc`` lies in [-1, 1].

    Sampled by inverting the distribution function, so gradients reach ``loc`` and ``scale``.

    Source: DreamerV2 (``trunc_normal``); PyTorch has none.
    """

    loc: Float[Tensor, "*B A"]
    scale: Float[Tensor, "*B A"]

    @property
    def mode(self) -> Float[Tensor, "*B A"]:
        """The most likely action."""
        return self.loc

    def rsample(self, generator: torch.Generator) -> Float[Tensor, "*B A"]:
        """A differentiable sample; clipping at the limits passes the gradient through."""
        alpha, beta = self._standard_limits()
        low, high = torch.special.ndtr(alpha), torch.special.ndtr(beta)
        uniform = torch.rand(self.loc.shape, generator=generator, device=self.loc.device)
        eps = torch.finfo(uniform.dtype).eps
        quantile = (low + uniform * (high - low)).clamp(eps, 1 - eps)
        sample = self.loc + self.scale * torch.special.ndtri(quantile)
        clipped = sample.clamp(-1 + SAMPLE_MARGIN, 1 - SAMPLE_MARGIN)
        return sample + (clipped - sample).detach()

    def log_prob(self, value: Float[Tensor, "*B A"]) -> Float[Tensor, "*B"]:
        """Log density, summed over the action dimensions."""
        standard = (value - self.loc) / self.scale
        log_normal = -0.5 * standard**2 - 0.5 * math.log(2 * math.pi) - self.scale.log()
        return (log_normal - self._mass().log()).sum(-1)

    def entropy(self) -> Float[Tensor, "*B"]:
        """Differential entropy in nats, summed over the action dimensions."""
        alpha, beta = self._standard_limits()
        mass = self._mass()
        edge = (alpha * _density(alpha) - beta * _density(beta)) / (2 * mass)
        return (torch.log(math.sqrt(2 * math.pi * math.e) * self.scale * mass) + edge).sum(-1)

    def _standard_limits(self) -> tuple[Tensor, Tensor]:
        return (-1 - self.loc) / self.scale, (1 - self.loc) / self.scale

    def _mass(self) -> Tensor:
        alpha, beta = self._standard_limits()
        return torch.special.ndtr(beta) - torch.special.ndtr(alpha)


def _density(x: Tensor) -> Tensor:
    return torch.exp(-0.5 * x**2) / math.sqrt(2 * math.pi)
