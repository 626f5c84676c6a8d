"""One step of learning for the autoencoder, used by pretraining and by online finetuning.

Owns the way from frames to one optimizer step. Where frames come from and when steps are taken is up
to the loops.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from langwm_data.seeding import derive_seed, make_rng
from pretrain.augment import augment_frame
from pretrain.batch import MAEBatch
from pretrain.config import AugmentConfig, ObjectMaskConfig
from pretrain.frames import FrameBatch
from pretrain.language import FrozenText
from pretrain.losses import ADDITIVE, loss_counts, mae_loss
from pretrain.mae import LanguageGroundedMAE
from pretrain.object_masking import HiddenObjects, hide_objects
from pretrain.optim import Optimizer
from pretrain.parts import count_parts
from pretrain.precision import autocast
from pretrain.team import ALONE, Team


def make_mae_batch(
    rngs: Sequence[np.random.Generator],
    frames: FrameBatch,
    text: FrozenText,
    objects: ObjectMaskConfig,
    augment: AugmentConfig | None,
) -> MAEBatch:
    """Augment frames, hide objects in them and encode what is said about those.

    Args:
        rngs: One for each frame, the source of every choice about it; may be the same one.
        frames: As they were seen.
        text: Encodes the captions.
        objects: What to hide.
        augment: ``None`` leaves the frames as they are, for validation.
    """
    seen, size = [], frames.depth.shape[1:]
    for rng, rgb, depth, held in zip(rngs, frames.rgb, frames.depth, frames.objects, strict=True):
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
    mae: LanguageGroundedMAE,
    optimizer: Optimizer,
    batch: MAEBatch,
    *,
    seed: int,
    step: int,
    team: Team = ALONE,
) -> dict[str, float]:
    """Take gradient step number ``step`` on ``batch``; its metrics.

    Token masks and dropout depend on seed and step alone, so an interrupted run goes on with the
    same numbers.

    Args:
        mae: What learns.
        optimizer: How, and in how many parts.
        batch: This member's rows of the whole batch.
        seed: Of the run.
        step: The first is 0.
        team: Who shares the batch.

    Raises:
        FloatingPointError: If the loss is not finite.
    """
    mae.train()
    device, num_rows = mae.device, len(batch)
    batch = batch.to(device)
    generator = torch.Generator().manual_seed(torch_seed(seed, "tokens", step))
    own = team.rows(num_rows * team.size)
    noise = mae.token_noise(num_rows * team.size, generator)[own.start : own.stop].to(device)
    counts = team.add(loss_counts(batch, mae.config))
    others = [] if device.type == "cpu" else [device]
    num_parts = max(optimizer.config.accumulate, count_parts(num_rows, device))
    found: list[tuple[int, dict[str, Tensor]]] = []
    optimizer.forget_gradients()
    with torch.random.fork_rng(others, device_type=device.type):
        torch.manual_seed(torch_seed(seed, "dropout", step) + team.rank)
        for start, end in pairwise(k * num_rows // num_parts for k in range(num_parts + 1)):
            rows = slice(start, end)
            part = batch.rows(rows)
            with autocast(device, optimizer.config.precision):
                output = mae(part, noise[rows])
            loss, metrics = mae_loss(output, part, mae.config, counts)
            loss.backward()
            found.append((end - start, {"loss": loss.detach(), **metrics}))
    team.add_gradients(optimizer.parameters)
    summed = _summed(found, team)
    taken = optimizer.apply_gradients(summed.pop("loss"), step)
    return summed | {f"mae/{name}": value for name, value in taken.items()}


def _summed(parts: list[tuple[int, dict[str, Tensor]]], team: Team) -> dict[str, float]:
    """Metrics of all parts of a step, each with its number of rows: losses add up, shares are averaged."""
    num_rows = sum(rows for rows, _ in parts) * team.size

    def total(name: str) -> Tensor:
        shares = [1 if name in ADDITIVE else rows / num_rows for rows, _ in parts]
        return torch.stack(
            [s * found[name].float() for s, (_, found) in zip(shares, parts, strict=True)]
        ).sum()

    names = list(parts[0][1])
    return dict(zip(names, team.add(torch.stack([total(name) for name in names])).tolist(), strict=True))


def torch_seed(seed: int, *names: str | int) -> int:
    """A seed that PyTorch accepts for the piece of work called ``names``."""
    return derive_seed(seed, *names) % 2**63


def batch_rngs(seed: int, step: int, rows: range) -> list[np.random.Generator]:
    """Sources of the augmentation, boxes and captions of some rows of the batch of step ``step``."""
    return [make_rng(seed, "batch", step, row) for row in rows]
