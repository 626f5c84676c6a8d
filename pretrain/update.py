"""One step of learning for the autoencoder, used by pretraining and by online finetuning.

Owns the way from frames to one optimizer step. Where frames come from and when steps are taken is up
to the loops.
"""

import numpy as np
import torch

from langwm_data.seeding import derive_seed, make_rng
from pretrain.augment import augment_frame
from pretrain.batch import FrameBatch, MAEBatch
from pretrain.config import AugmentConfig, ObjectMaskConfig
from pretrain.language import FrozenText
from pretrain.losses import mae_loss
from pretrain.mae import LanguageGroundedMAE
from pretrain.object_masking import HiddenObjects, hide_objects
from pretrain.optim import Optimizer


def make_mae_batch(
    rng: np.random.Generator,
    frames: FrameBatch,
    text: FrozenText,
    objects: ObjectMaskConfig,
    augment: AugmentConfig | None,
) -> MAEBatch:
    """Augment frames, hide objects in them and encode what is said about those.

    Args:
        rng: Source of every choice.
        frames: As they were seen.
        text: Encodes the captions.
        objects: What to hide.
        augment: ``None`` leaves the frames as they are, for validation.
    """
    seen, size = [], frames.depth.shape[1:]
    for rgb, depth, held in zip(frames.rgb, frames.depth, frames.objects, strict=True):
        if augment is not None:
            rgb, depth, held = augment_frame(rng, rgb, depth, held, augment)
        seen.append((rgb, depth, hide_objects(rng, held, size, objects)))
    hidden = [h for _, _, h in seen]
    changed = FrameBatch(
        rgb=np.stack([rgb for rgb, _, _ in seen]),
        depth=np.stack([depth for _, depth, _ in seen]),
        objects=[list(h.objects) for h in hidden],
        reward=frames.reward,
        has_reward=frames.has_reward,
    )
    return assemble(changed, hidden, text)


def assemble(frames: FrameBatch, hidden: list[HiddenObjects], text: FrozenText) -> MAEBatch:
    """Tensors of frames, of what is hidden in them, and of the captions."""
    captions = tuple(h.caption for h in hidden)
    tokens, is_truncated = text.embed(captions)
    return MAEBatch(
        rgb=torch.from_numpy(frames.rgb),
        is_hidden=torch.from_numpy(np.stack([h.is_hidden for h in hidden])),
        depth=torch.from_numpy(frames.depth),
        text=tokens,
        captions=captions,
        is_truncated=is_truncated,
        reward=torch.from_numpy(frames.reward),
        has_reward=torch.from_numpy(frames.has_reward),
    )


def mae_update(
    mae: LanguageGroundedMAE, optimizer: Optimizer, batch: MAEBatch, *, seed: int, step: int
) -> dict[str, float]:
    """Take gradient step number ``step`` on ``batch``; its metrics.

    Token masks and dropout depend on seed and step alone, so an interrupted run goes on with the
    same numbers.

    Raises:
        FloatingPointError: If the loss is not finite.
    """
    mae.train()
    device = mae.device
    batch = batch.to(device)
    others = [] if device.type == "cpu" else [device]
    generator = torch.Generator().manual_seed(torch_seed(seed, "tokens", step))
    with torch.random.fork_rng(others, device_type=device.type):
        torch.manual_seed(torch_seed(seed, "dropout", step))
        with torch.autocast(device.type, torch.bfloat16, enabled=optimizer.config.precision == "bf16"):
            output = mae(batch, generator)
        loss, metrics = mae_loss(output, batch, mae.config)
        taken = optimizer.step(loss, step)
    return {name: value.item() for name, value in metrics.items()} | {
        f"mae/{name}": value for name, value in taken.items()
    }


def torch_seed(seed: int, *names: str | int) -> int:
    """A seed that PyTorch accepts for the piece of work called ``names``."""
    return derive_seed(seed, *names) % 2**63


def batch_rng(seed: int, step: int) -> np.random.Generator:
    """Source of the augmentation, boxes and captions of step ``step``."""
    return make_rng(seed, "batch", step)
