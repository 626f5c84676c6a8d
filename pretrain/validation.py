"""Held-out depth error while training: a fixed batch with fixed boxes and token masks."""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from langwm_data.seeding import make_rng
from pretrain.batch import MAEBatch, TextTokens
from pretrain.config import ObjectMaskConfig
from pretrain.dataset import FrameDataset
from pretrain.language import FrozenText
from pretrain.losses import masked_mean, target_error
from pretrain.mae import LanguageGroundedMAE, MAEOutput, evaluating
from pretrain.update import make_mae_batch, torch_seed

_CHUNK = 64


def make_validation_batch(
    frames: FrameDataset, text: FrozenText, objects: ObjectMaskConfig, *, num_frames: int, seed: int
) -> MAEBatch:
    """Randomly chosen frames, not augmented, always with boxes and captions where there are objects."""
    rng = make_rng(seed, "validation")
    numbers = rng.choice(len(frames), size=min(num_frames, len(frames)), replace=False).tolist()
    return make_mae_batch([rng] * len(numbers), frames.batch(numbers), text, always_hide(objects), None)


def always_hide(objects: ObjectMaskConfig) -> ObjectMaskConfig:
    """The same limits without dropout."""
    return replace(objects, caption_dropout=0.0, box_dropout=0.0)


def predict_depth(
    mae: LanguageGroundedMAE, batch: MAEBatch, text: TextTokens, seed: int
) -> Float[Tensor, "B H W"]:
    """Predicted depth in metres, on the CPU, with dropout off; arguments as ``predict_image`` has them."""
    assert mae.config.target == "depth"
    return predict_image(mae, batch, text, seed)[:, 0] * mae.config.max_depth_m


@torch.no_grad()
def predict_image(
    mae: LanguageGroundedMAE, batch: MAEBatch, text: TextTokens, seed: int
) -> Float[Tensor, "B C H W"]:
    """The predicted target in the units of ``MAEOutput.image``, on the CPU, with dropout off.

    Args:
        mae: Its mode is kept.
        batch: Frames and boxes.
        text: Captions, in place of the batch's own.
        seed: Of the token masks: the same seed drops the same tokens whatever the text.
    """
    generator = torch.Generator().manual_seed(torch_seed(seed, "predict"))
    parts = []
    with evaluating(mae):
        for start in range(0, len(batch), _CHUNK):
            part = batch.rows(slice(start, start + _CHUNK), text).to(mae.device)
            parts.append(mae(part, mae.token_noise(len(part), generator)).image.cpu())
    return torch.cat(parts)


def depth_error_m(
    depth_m: Float[Tensor, "B H W"], batch: MAEBatch, max_depth_m: float, where: Bool[Tensor, "B H W"]
) -> Float[Tensor, ""]:
    """Mean absolute error in metres over valid pixels of a region, true depth clipped as in training."""
    error = (depth_m - batch.depth.clamp(max=max_depth_m)).abs()
    return masked_mean(error, where & (batch.depth > 0))


def validate(
    mae: LanguageGroundedMAE, batch: MAEBatch, seed: int
) -> tuple[dict[str, float], Float[Tensor, "B C H W"]]:
    """Metrics of the validation batch, and what is predicted for it: depth in metres, or colours."""
    if mae.config.target == "rgb":
        image = predict_image(mae, batch, batch.text, seed)
        error, _ = target_error(MAEOutput(image=image, reward=batch.reward), batch, mae.config)
        return {"valid/rgb_loss": error.mean().item()}, image
    limit = mae.config.max_depth_m
    depth = predict_depth(mae, batch, batch.text, seed)
    untold = predict_depth(mae, batch, mae.null_text(len(batch)), seed)
    everywhere = torch.ones_like(batch.is_hidden)
    errors = {
        "valid/depth_error_m": depth_error_m(depth, batch, limit, everywhere),
        "valid/hidden_depth_error_m": depth_error_m(depth, batch, limit, batch.is_hidden),
        "valid/hidden_depth_error_m_no_caption": depth_error_m(untold, batch, limit, batch.is_hidden),
    }
    return {name: error.item() for name, error in errors.items()}, depth[:, None]
