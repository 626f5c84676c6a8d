"""Does the autoencoder use language? Depth around one hidden object, told the truth, nothing or a lie.

Owns the measurement. All predictions for a frame share pixels, box and token mask; only the caption
differs. What is made of the errors stands in ``compare``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import torch
from jaxtyping import Bool, Float
from numpy.typing import NDArray
from torch import Tensor

from langwm_data.config_io import ConfigError
from langwm_data.seeding import derive_seed
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.claims import CAPTIONS, EMPTY, RIGHT
from pretrain.probing.scene import DepthPrior, ProbeScene
from pretrain.validation import predict_depth

MEAN, PIXEL_MEAN = "mean", "pixel_mean"
"""Baselines in the place of a caption: the training frames' mean depth, in all and at each pixel."""
BOX, OBJECT, MARGIN, ELSEWHERE = "box", "object", "margin", "elsewhere"
REGIONS: tuple[str, ...] = (BOX, OBJECT, MARGIN, ELSEWHERE)
"""All that is hidden; the object in it; the rest of the box; all that is not hidden."""

_CHUNK = 64

Errors = NDArray[np.float64]
"""One number per frame, metres; not a number where there is nothing to measure."""


@dataclass(frozen=True, kw_only=True)
class GroundingResult:
    """What was measured, frame by frame."""

    scene: ProbeScene
    errors: Mapping[str, Mapping[str, Errors]]
    """By caption or baseline, then by region: mean absolute depth error."""
    depths: Mapping[str, Errors]
    """By caption or baseline: mean predicted depth of the object."""

    def errors_in(self, region: str) -> dict[str, Errors]:
        """Errors in one region, by caption or baseline."""
        return {name: held[region] for name, held in self.errors.items()}

    def to_table(self, **columns: str) -> pa.Table:
        """A row per frame and caption, to be written as parquet.

        Args:
            columns: More columns, each with one value for all rows.
        """
        rows = []
        for i, (key, shown, told) in enumerate(
            zip(self.scene.keys, self.scene.objects, self.scene.claims, strict=True)
        ):
            for name in self.errors:
                claim = told.get(name)
                if claim is None and name in CAPTIONS:
                    continue
                rows.append(
                    {
                        **columns,
                        "key": key,
                        "category": shown.category,
                        "model": shown.model,
                        "distance_m": shown.distance_m,
                        "caption": name,
                        "text": claim.text if claim else "",
                        "told_distance_m": _or_none(claim.distance_m if claim else np.nan),
                        "predicted_m": _or_none(self.depths[name][i]),
                    }
                    | {f"error_{r}_m": _or_none(self.errors[name][r][i]) for r in REGIONS}
                )
        return pa.Table.from_pylist(rows)


def measure_grounding(
    mae: LanguageGroundedMAE,
    text: FrozenText,
    scene: ProbeScene,
    prior: DepthPrior,
    *,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> GroundingResult:
    """Errors of one model on one scene with every caption, and of not looking at all.

    Args:
        mae: The model, on any device.
        text: The encoder it was trained with.
        scene: The frames.
        prior: Of the training frames.
        seed: Of the token masks.
        progress: Called with frames done and all frames.

    Raises:
        ConfigError: If no hidden object has a pixel with valid depth.
    """
    parts = []
    for start in range(0, len(scene), _CHUNK):
        rows = slice(start, start + _CHUNK)
        depth_of = predict_with_captions(mae, text, scene, seed, rows=rows)
        truth = scene.batch.depth[rows]
        depth_of[MEAN] = torch.full_like(truth, prior.mean_m)
        depth_of[PIXEL_MEAN] = torch.from_numpy(prior.pixel_mean_m).expand_as(truth)
        parts.append(_measure_chunk(scene, rows, depth_of, mae.config.max_depth_m))
        progress(min(start + _CHUNK, len(scene)), len(scene))
    joined = {name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0]}
    errors: dict[str, dict[str, Errors]] = {
        name: dict(zip(REGIONS, values[:-1], strict=True)) for name, values in joined.items()
    }
    if not np.isfinite(errors[RIGHT][OBJECT]).any():
        raise ConfigError(f"none of the {len(scene)} hidden objects has a pixel with valid depth")
    return GroundingResult(
        scene=scene, errors=errors, depths={name: values[-1] for name, values in joined.items()}
    )


def predict_with_captions(
    mae: LanguageGroundedMAE,
    text: FrozenText,
    scene: ProbeScene,
    seed: int,
    *,
    rows: slice = slice(None),
) -> dict[str, Float[Tensor, "B H W"]]:
    """Depth in metres by caption for some frames; meaningless where a frame lacks a caption.

    Args:
        mae: The model.
        text: The encoder it was trained with.
        scene: The frames.
        seed: Of the token masks: the same for all captions.
        rows: Which of the frames.
    """
    batch, claims = scene.batch.rows(rows), scene.claims[rows]
    seed = derive_seed(seed, "probe", rows.start or 0)
    depth_of = {}
    for name in CAPTIONS:
        if name == EMPTY:
            tokens = mae.null_text(len(batch)).to("cpu")
        else:
            tokens, _ = text.embed([told[name].text if name in told else "" for told in claims])
        depth_of[name] = predict_depth(mae, batch, tokens, seed)
    return depth_of


def _measure_chunk(
    scene: ProbeScene, rows: slice, depth_of: Mapping[str, Tensor], max_depth_m: float
) -> dict[str, NDArray[np.float64]]:
    """By caption the errors in all regions and the predicted depth of the object, (regions + 1, B)."""
    batch, is_object = scene.batch.rows(rows), scene.is_object[rows]
    truth, is_valid = batch.depth.clamp(max=max_depth_m), batch.depth > 0
    regions = {
        BOX: batch.is_hidden,
        OBJECT: batch.is_hidden & is_object,
        MARGIN: batch.is_hidden & ~is_object,
        ELSEWHERE: ~batch.is_hidden,
    }
    measured = {}
    for name, depth in depth_of.items():
        error = (depth - truth).abs()
        means = [mean_over(error, regions[region] & is_valid) for region in REGIONS]
        means.append(mean_over(depth, regions[OBJECT] & is_valid))
        values = torch.stack(means).double().numpy()
        if name in CAPTIONS:
            values[:, [name not in told for told in scene.claims[rows]]] = np.nan
        measured[name] = values
    return measured


def mean_over(x: Float[Tensor, "B H W"], where: Bool[Tensor, "B H W"]) -> Float[Tensor, " B"]:
    """Mean of each frame over a region; not a number where that is empty."""
    return (x * where).sum(dim=(1, 2)) / where.sum(dim=(1, 2))


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
