"""Frames with one hidden object each, what is said of them, and what can be said without looking."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool
from numpy.typing import NDArray
from torch import Tensor

from langwm_data.config_io import ConfigError
from langwm_data.seeding import make_rng
from pretrain.batch import MAEBatch
from pretrain.config import ObjectMaskConfig
from pretrain.dataset import FrameDataset
from pretrain.frames import FrameObject
from pretrain.language import FrozenText
from pretrain.object_masking import HiddenObjects, box_with_margin
from pretrain.probing.claims import RIGHT, Claims, make_claims
from pretrain.update import assemble

MAX_DONORS = 2000
"""Objects of other frames whose captions and nouns are used for lies."""
_CHUNK = 64


@dataclass(frozen=True, kw_only=True)
class DepthPrior:
    """What can be said about depth without looking: means over training frames, metres."""

    mean_m: float
    pixel_mean_m: NDArray[np.float32]
    """(H, W)."""

    @classmethod
    def of(cls, frames: FrameDataset, max_depth_m: float, *, max_frames: int = 1000) -> "DepthPrior":
        """Means over the valid pixels of evenly spaced frames, depth clipped as in training."""
        numbers = np.linspace(0, len(frames) - 1, min(len(frames), max_frames)).astype(int)
        total, count = np.zeros(1), np.zeros(1, dtype=np.int64)
        for start in range(0, len(numbers), _CHUNK):
            depth = frames.batch(numbers[start : start + _CHUNK].tolist()).depth
            total = total + np.minimum(depth, max_depth_m).sum(axis=0, dtype=np.float64)
            count = count + (depth > 0).sum(axis=0)
        mean = float(total.sum() / max(count.sum(), 1))
        per_pixel = np.where(count > 0, total / np.maximum(count, 1), mean).astype(np.float32)
        return cls(mean_m=mean, pixel_mean_m=per_pixel)


@dataclass(frozen=True, kw_only=True)
class ProbeScene:
    """Frames with one hidden object each; boxes and captions are drawn, so every model is told the same."""

    keys: tuple[str, ...]
    batch: MAEBatch
    """With the right captions."""
    is_object: Bool[Tensor, "B H W"]
    """Pixels of the hidden object itself, without what its box hides besides."""
    objects: tuple[FrameObject, ...]
    claims: tuple[Claims, ...]

    def __len__(self) -> int:
        return len(self.keys)


def make_probe_scene(
    frames: FrameDataset, text: FrozenText, objects: ObjectMaskConfig, *, num_frames: int, seed: int
) -> ProbeScene:
    """Choose frames with objects, hide one object in each behind a box with margins, and draw captions.

    Args:
        frames: To choose from, at random.
        text: Encodes the right captions.
        objects: Margins and how distances are said; all that ``max_objects`` and the switches say is left
            aside, so that models trained in different ways are asked the same.
        num_frames: At most.
        seed: Of every choice.

    Raises:
        ConfigError: If no frame has an object.
    """
    rng = make_rng(seed, "probe")
    usable = [n for n in rng.permutation(len(frames)).tolist() if frames.objects[n]]
    if not usable:
        raise ConfigError(f"the frames of {str(frames.shards.path)!r} show no object that could be hidden")
    numbers = sorted(usable[:num_frames])
    seen = frames.batch(numbers)
    height, width = seen.depth.shape[1:]
    donors = _some(make_rng(seed, "donors"), [o for held in frames.objects for o in held])
    shown = [held[rng.integers(len(held))] for held in seen.objects]
    boxes = [box_with_margin(rng, o, (height, width), objects.margin_px) for o in shown]
    claims = tuple(make_claims(rng, o, donors, width, objects.distance_format) for o in shown)
    hidden = [
        HiddenObjects(is_hidden=_inside(box, height, width), objects=(o,), caption=told[RIGHT].text)
        for o, box, told in zip(shown, boxes, claims, strict=True)
    ]
    masks, keys = frames.shards.only("instance"), frames.keys
    is_object = [masks[n]["instance"] == o.instance for n, o in zip(numbers, shown, strict=True)]
    return ProbeScene(
        keys=tuple(keys[number] for number in numbers),
        batch=assemble(seen, hidden, text),
        is_object=torch.from_numpy(np.stack(is_object)),
        objects=tuple(shown),
        claims=claims,
    )


def _some(rng: np.random.Generator, objects: list[FrameObject]) -> list[FrameObject]:
    """Enough of them to choose from: each hidden object looks through all."""
    if len(objects) <= MAX_DONORS:
        return objects
    return [objects[n] for n in rng.permutation(len(objects))[:MAX_DONORS]]


def _inside(box: tuple[int, int, int, int], height: int, width: int) -> NDArray[np.bool_]:
    x1, y1, x2, y2 = box
    is_inside = np.zeros((height, width), dtype=np.bool_)
    is_inside[y1:y2, x1:x2] = True
    return is_inside
