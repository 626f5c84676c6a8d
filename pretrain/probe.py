"""Does the autoencoder use language? Depth inside one hidden box, told the truth, nothing or a lie.

Owns the measurement on held-out frames and its intervals. All three predictions for a frame share
pixels, box and token mask; only the caption differs.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import torch
from numpy.typing import NDArray
from torch import Tensor

from langwm_data.config_io import ConfigError
from langwm_data.labels.captions import sample_caption
from langwm_data.seeding import make_rng
from pretrain.batch import FrameObject, MAEBatch
from pretrain.config import ObjectMaskConfig
from pretrain.dataset import FrameDataset
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.object_masking import hide_objects
from pretrain.update import assemble
from pretrain.validation import always_hide, predict_depth

MIN_WRONG_M = 1.0
"""A wrong caption is wrong by at least this much, and names another category."""
RESAMPLES = 10_000


@dataclass(frozen=True, kw_only=True)
class ProbeRow:
    """One held-out frame with one hidden object. Errors: mean absolute depth error in its box, metres."""

    key: str
    category: str
    distance_m: float
    hidden_px: int
    caption: str
    wrong_caption: str
    wrong_distance_m: float
    error_right_m: float
    error_empty_m: float
    error_wrong_m: float
    error_mean_m: float
    """Of predicting the mean depth of the training frames."""
    error_pixel_mean_m: float
    """Of predicting the training frames' mean depth at each pixel."""


@dataclass(frozen=True, kw_only=True)
class Difference:
    """How much larger one error is than the error with the right caption, paired by frame."""

    compared: str
    mean_m: float
    low_m: float
    high_m: float
    """95 % percentile bootstrap interval."""


@dataclass(frozen=True, kw_only=True)
class ProbeResult:
    """Everything the probe measured."""

    rows: tuple[ProbeRow, ...]
    differences: tuple[Difference, ...]
    """Against the empty and the wrong caption, and the two means."""

    def to_table(self) -> pa.Table:
        """A row per frame, to be written as parquet."""
        return pa.Table.from_pylist([dataclasses.asdict(row) for row in self.rows])

    def mean_error_m(self, which: str) -> float:
        """Mean over frames of ``error_<which>_m``."""
        return float(np.mean(_errors(self.rows, which)))


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
        for start in range(0, len(numbers), 64):
            depth = frames.batch(numbers[start : start + 64].tolist()).depth
            total = total + np.minimum(depth, max_depth_m).sum(axis=0, dtype=np.float64)
            count = count + (depth > 0).sum(axis=0)
        mean = float(total.sum() / max(count.sum(), 1))
        per_pixel = np.where(count > 0, total / np.maximum(count, 1), mean).astype(np.float32)
        return cls(mean_m=mean, pixel_mean_m=per_pixel)


@dataclass(frozen=True, kw_only=True)
class ProbeScene:
    """The frames that are probed, each with one hidden object, and what is wrongly said about them."""

    keys: tuple[str, ...]
    batch: MAEBatch
    objects: tuple[FrameObject, ...]
    wrong: tuple[tuple[str, FrameObject], ...]
    """Caption and the object of another frame that it describes."""


def make_probe_scene(
    frames: FrameDataset, text: FrozenText, objects: ObjectMaskConfig, *, num_frames: int, seed: int
) -> ProbeScene:
    """Choose frames with objects, hide one object in each, and draw captions.

    Raises:
        ConfigError: If no frame has an object, or no two objects differ enough for a wrong caption.
    """
    rng = make_rng(seed, "probe")
    usable = [n for n in rng.permutation(len(frames)).tolist() if frames.objects[n]]
    if not usable:
        raise ConfigError("the held-out frames show no object that could be hidden")
    numbers = sorted(usable[:num_frames])
    seen = frames.batch(numbers)
    config = dataclasses.replace(always_hide(objects), max_objects=1)
    hidden = [hide_objects(rng, held, seen.depth.shape[1:], config) for held in seen.objects]
    donors = [o for held in frames.objects for o in held]
    width = seen.depth.shape[2]
    wrong = tuple(_wrong_caption(rng, h.objects[0], donors, width, config) for h in hidden)
    keys = frames.keys
    return ProbeScene(
        keys=tuple(keys[number] for number in numbers),
        batch=assemble(seen, hidden, text),
        objects=tuple(h.objects[0] for h in hidden),
        wrong=wrong,
    )


def _wrong_caption(
    rng: np.random.Generator,
    shown: FrameObject,
    donors: Sequence[FrameObject],
    width: int,
    config: ObjectMaskConfig,
) -> tuple[str, FrameObject]:
    fitting = [
        o
        for o in donors
        if o.category != shown.category and abs(o.distance_m - shown.distance_m) >= MIN_WRONG_M
    ]
    if not fitting:
        raise ConfigError(f"the held-out frames show no object that a {shown.category} could be mistaken for")
    donor = fitting[rng.integers(len(fitting))]
    caption = sample_caption(
        rng, donor.noun, donor.center_x, width, donor.distance_m, distance_format=config.distance_format
    )
    return caption.text, donor


def probe_grounding(
    mae: LanguageGroundedMAE, text: FrozenText, scene: ProbeScene, prior: DepthPrior, *, seed: int
) -> ProbeResult:
    """Compare the right caption with none, with a wrong one, and with not looking at all.

    Args:
        mae: The model, on any device.
        text: The encoder it was trained with.
        scene: Held-out frames.
        prior: Of the training frames.
        seed: Of token masks and of the bootstrap.

    Raises:
        ConfigError: If no hidden box covers a pixel with valid depth.
    """
    batch = scene.batch
    depth_of = predict_with_captions(mae, text, scene, seed)
    depth_of["mean"] = torch.full_like(batch.depth, prior.mean_m)
    depth_of["pixel_mean"] = torch.from_numpy(prior.pixel_mean_m).expand_as(batch.depth)
    error_of = {name: _box_error_m(depth, batch, mae.config.max_depth_m) for name, depth in depth_of.items()}
    rows = tuple(
        _row(scene, i, {name: e[i].item() for name, e in error_of.items()}) for i in range(len(batch))
    )
    rows = tuple(row for row in rows if np.isfinite(row.error_right_m))
    if not rows:
        raise ConfigError(f"none of the {len(batch)} hidden boxes covers a pixel with valid depth")
    compared = ("empty", "wrong", "mean", "pixel_mean")
    return ProbeResult(rows=rows, differences=tuple(_difference(rows, name, seed) for name in compared))


def predict_with_captions(
    mae: LanguageGroundedMAE, text: FrozenText, scene: ProbeScene, seed: int
) -> dict[str, Tensor]:
    """Depth (B, H, W) in metres with the ``right``, the ``empty`` and the ``wrong`` caption."""
    wrong, _ = text.embed([caption for caption, _ in scene.wrong])
    texts = {"right": scene.batch.text, "empty": mae.null_text(len(scene.batch)).to("cpu"), "wrong": wrong}
    return {name: predict_depth(mae, scene.batch, tokens, seed) for name, tokens in texts.items()}


def _box_error_m(depth_m: Tensor, batch: MAEBatch, max_depth_m: float) -> Tensor:
    """Per frame; not a number where the box covers no valid pixel."""
    where = batch.is_hidden & (batch.depth > 0)
    error = (depth_m - batch.depth.clamp(max=max_depth_m)).abs()
    return (error * where).sum(dim=(1, 2)) / where.sum(dim=(1, 2))


def _row(scene: ProbeScene, i: int, error_of: dict[str, float]) -> ProbeRow:
    wrong_caption, donor = scene.wrong[i]
    return ProbeRow(
        key=scene.keys[i],
        category=scene.objects[i].category,
        distance_m=scene.objects[i].distance_m,
        hidden_px=int(scene.batch.is_hidden[i].sum()),
        caption=scene.batch.captions[i],
        wrong_caption=wrong_caption,
        wrong_distance_m=donor.distance_m,
        **{f"error_{name}_m": error for name, error in error_of.items()},
    )


def _errors(rows: Sequence[ProbeRow], which: str) -> NDArray[np.float64]:
    return np.array([getattr(row, f"error_{which}_m") for row in rows])


def _difference(rows: Sequence[ProbeRow], compared: str, seed: int) -> Difference:
    difference = _errors(rows, compared) - _errors(rows, "right")
    rng = make_rng(seed, "bootstrap", compared)
    means = difference[rng.integers(len(difference), size=(RESAMPLES, len(difference)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return Difference(
        compared=compared, mean_m=float(difference.mean()), low_m=float(low), high_m=float(high)
    )
