"""Losses of the autoencoder. Pure functions of tensors."""

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from pretrain.batch import MAEBatch
from pretrain.config import MAEConfig
from pretrain.mae import IMAGENET_MEAN, IMAGENET_STD, MAEOutput

ADDITIVE = ("loss", "mae/depth_loss", "mae/rgb_loss", "mae/reward_loss")
"""Metrics of parts of a step that add up to that of the whole; the others are averaged."""


def symlog(x: Tensor) -> Tensor:
    """Logarithm of the magnitude with the sign kept; near zero it is the identity. Source: MWM."""
    return x.sign() * x.abs().log1p()


def masked_mean(x: Tensor, mask: Bool[Tensor, "..."]) -> Float[Tensor, ""]:
    """Mean of ``x`` where ``mask`` is true; 0 where nothing is."""
    weight = mask.to(x.dtype)
    return (x * weight).sum() / weight.sum().clamp(min=1)


def target_error(
    output: MAEOutput, batch: MAEBatch, config: MAEConfig
) -> tuple[Float[Tensor, "B H W"], Bool[Tensor, "B H W"]]:
    """Squared error of each pixel of the target, and which pixels have one."""
    if config.target == "rgb":
        mean, std = (
            output.image.new_tensor(values)[:, None, None] for values in (IMAGENET_MEAN, IMAGENET_STD)
        )
        target = (rearrange(batch.rgb, "b h w c -> b c h w") / 255 - mean) / std
        return (output.image - target).square().mean(dim=1), torch.ones_like(batch.is_hidden)
    depth = batch.depth.clamp(max=config.max_depth_m) / config.max_depth_m
    return (output.depth - depth).square(), batch.depth > 0


def loss_counts(batch: MAEBatch, config: MAEConfig) -> Float[Tensor, "2"]:
    """How many pixels of the target and how many rewards a batch has to learn from."""
    pixels = batch.is_hidden.numel() if config.target == "rgb" else (batch.depth > 0).sum()
    counts = [torch.as_tensor(pixels, device=batch.depth.device), batch.has_reward.sum()]
    return torch.stack(counts).float()


def mae_loss(
    output: MAEOutput, batch: MAEBatch, config: MAEConfig, counts: Float[Tensor, "2"] | None = None
) -> tuple[Float[Tensor, ""], dict[str, Tensor]]:
    """Squared error of the target over all valid pixels plus that of reward where there is one.

    Depth is in units of ``max_depth_m``, colours are in ImageNet's. Pixels of dropped tokens and of
    hidden objects count like all others, since the convolutions have seen around them.

    Args:
        output: What was predicted.
        batch: The truth.
        config: What is predicted, and how rewards are compared.
        counts: Of ``loss_counts``, over all parts of a step of which this batch is one; its own if not
            given. The losses of the parts add up to that of the whole.

    Source: Eq. 3 (row 8), Sec. 3.1.1; weights of 1 from MWM.
    """
    error, is_valid = target_error(output, batch, config)
    reward = symlog(batch.reward) if config.reward_loss == "symlog" else batch.reward
    pixels, rewards = (loss_counts(batch, config) if counts is None else counts).clamp(min=1)
    losses = {
        config.target: (error * is_valid).sum() / pixels,
        "reward": ((output.reward - reward).square() * batch.has_reward).sum() / rewards,
    }
    metrics = {
        f"mae/{config.target}_loss": losses[config.target].detach(),
        "mae/reward_loss": losses["reward"].detach(),
        f"mae/hidden_{config.target}_loss": masked_mean(error, is_valid & batch.is_hidden).detach(),
        "mae/mask_fraction": batch.is_hidden.float().mean(),
        "mae/truncation_rate": batch.is_truncated.float().mean(),
    }
    return torch.stack(list(losses.values())).sum(), metrics
