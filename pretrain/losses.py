"""Losses of the autoencoder. Pure functions of tensors."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pretrain.batch import MAEBatch
from pretrain.config import MAEConfig
from pretrain.mae import MAEOutput


def symlog(x: Tensor) -> Tensor:
    """Logarithm of the magnitude with the sign kept; near zero it is the identity. Source: MWM."""
    return x.sign() * x.abs().log1p()


def masked_mean(x: Tensor, mask: Bool[Tensor, "..."]) -> Float[Tensor, ""]:
    """Mean of ``x`` where ``mask`` is true; 0 where nothing is."""
    weight = mask.to(x.dtype)
    return (x * weight).sum() / weight.sum().clamp(min=1)


def mae_loss(
    output: MAEOutput, batch: MAEBatch, config: MAEConfig
) -> tuple[Float[Tensor, ""], dict[str, Tensor]]:
    """Squared error of depth over all valid pixels plus that of reward where there is one.

    Depth is in units of ``max_depth_m``. Pixels of dropped tokens and of hidden objects count like
    all others, since the convolutions have seen around them.

    Source: Eq. 3 (row 8), Sec. 3.1.1; weights of 1 from MWM.
    """
    target = batch.depth.clamp(max=config.max_depth_m) / config.max_depth_m
    depth_error = (output.depth - target).square()
    is_valid = batch.depth > 0
    reward = symlog(batch.reward) if config.reward_loss == "symlog" else batch.reward
    losses = {
        "depth": masked_mean(depth_error, is_valid),
        "reward": masked_mean((output.reward - reward).square(), batch.has_reward),
    }
    metrics = {
        "mae/depth_loss": losses["depth"].detach(),
        "mae/reward_loss": losses["reward"].detach(),
        "mae/hidden_depth_loss": masked_mean(depth_error, is_valid & batch.is_hidden).detach(),
        "mae/mask_fraction": batch.is_hidden.float().mean(),
        "mae/truncation_rate": batch.is_truncated.float().mean(),
    }
    return torch.stack(list(losses.values())).sum(), metrics
