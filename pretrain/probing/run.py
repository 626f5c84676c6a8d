"""What ``langwm probe-mae`` does: open, measure, sum up, write tables and a page.

Owns the order of the parts and the files. Numbers come from the modules beside it.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from langwm_data import atomic
from langwm_data.config_io import CONFIG_FILE, ConfigError, claim_output, config_to_dict, load_config_file
from langwm_data.scenes.spec import Split
from langwm_data.seeding import make_rng
from pretrain.config import ObjectMaskConfig, PretrainConfig, ProbeConfig
from pretrain.dataset import FrameDataset, open_split
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.features import (
    Encoder,
    choose_frames,
    encode_pixels,
    mae_encoder,
    random_encoder,
    see_frames,
)
from pretrain.probing.findings import Grounding, sum_up
from pretrain.probing.grounding import GroundingResult, measure_grounding
from pretrain.probing.report import REPORT_FILE, draw_grounding, render_report
from pretrain.probing.scene import DepthPrior, ProbeScene, make_probe_scene
from pretrain.probing.scores import FeatureScore, score_features

ROWS_FILE, FEATURES_FILE, SUMMARY_FILE = "probe.parquet", "features.parquet", "probe.json"
TRAIN_SHARE = 4
"""So many times more training than test frames are read for the features."""
THIS, RANDOM, RAW, BESIDE = "this model", "random encoder", "raw frame", "the other run"

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is probed, opened and checked."""

    config: ProbeConfig
    mae: LanguageGroundedMAE
    beside: LanguageGroundedMAE | None
    objects: ObjectMaskConfig
    splits: dict[Split, FrameDataset]


def probe_mae(
    config: ProbeConfig,
    out: Path,
    *,
    fresh: bool = False,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Probe a model and write ``probe.parquet``, ``features.parquet``, ``probe.json`` and ``report.html``.

    Of a model of colours only the features are probed, and there is no ``probe.parquet``.

    Args:
        config: What to probe, on what.
        out: Folder to write; the same call writes the same again.
        fresh: Throw away what another probe left in ``out``.
        progress: Called with frames read and all frames to read.

    Returns:
        The page.

    Raises:
        ValueError: If the request is wrong; nothing was written then.
    """
    subject = open_subject(config)
    text, scenes = None, None
    if subject.mae.config.target == "depth":
        text = FrozenText(subject.mae.text, config.device)
        scenes = _hide(subject, text)
    claim_output(out, config, fresh=fresh)
    count = _Count(subject, progress)
    grounding, pictures = None, None
    if text is not None and scenes is not None:
        measured = _ground(subject, text, scenes, count.go_on)
        rows = [result.to_table(split=split) for split, result in measured.items()]
        _write_table(out / ROWS_FILE, pa.concat_tables(rows))
        grounding = sum_up(measured, config.split, _model_splits(subject), config.seed)
        pictures = draw_grounding(subject.mae, text, grounding, config.seed)
    scores = _score(subject, count.go_on)
    _write_table(out / FEATURES_FILE, pa.Table.from_pylist([dataclasses.asdict(s) for s in scores]))
    atomic.write_json(out / SUMMARY_FILE, _summary(config, grounding, scores))
    atomic.write_text(out / REPORT_FILE, render_report(config, pictures, scores))
    count.finish()
    return out / REPORT_FILE


def open_subject(config: ProbeConfig) -> Subject:
    """Open the model, the run beside it and both splits.

    Raises:
        ValueError: If one of them is missing or does not fit.
    """
    mae = LanguageGroundedMAE.from_pretrained(config.run).to(config.device)
    size = (mae.config.height, mae.config.width)
    beside = None
    if config.beside is not None:
        beside = LanguageGroundedMAE.from_pretrained(config.beside).to(config.device)
        other = (beside.config.height, beside.config.width)
        if other != size:
            raise ConfigError(
                f"--beside {config.beside!r} reads frames of {other[0]}x{other[1]};"
                f" {config.run!r} reads {size[0]}x{size[1]}"
            )
    splits: dict[Split, FrameDataset] = {}
    for split in ("test", "train"):
        frames = open_split(Path(config.data), split, size, config.ram_mib)
        if frames is None:
            raise ConfigError(
                f"--data {config.data!r} has no {split} frames; a probe needs those of both splits, since"
                " what it fits is fitted on training frames"
            )
        splits[split] = frames
    objects = _objects_of(Path(config.run))
    return Subject(config=config, mae=mae, beside=beside, objects=objects, splits=splits)


def _objects_of(run: Path) -> ObjectMaskConfig:
    """Margins and how distances are said, as the run had them; the defaults for a model without its run."""
    path = run / CONFIG_FILE
    return load_config_file(PretrainConfig, path).objects if path.is_file() else ObjectMaskConfig()


def _hide(subject: Subject, text: FrozenText) -> dict[Split, ProbeScene]:
    config = subject.config
    return {
        split: make_probe_scene(frames, text, subject.objects, num_frames=config.frames, seed=config.seed)
        for split, frames in subject.splits.items()
    }


def _ground(
    subject: Subject, text: FrozenText, scenes: dict[Split, ProbeScene], go_on: Progress
) -> dict[Split, GroundingResult]:
    mae = subject.mae
    prior = DepthPrior.of(subject.splits["train"], mae.config.max_depth_m)
    return {
        split: measure_grounding(mae, text, scene, prior, seed=subject.config.seed, progress=go_on)
        for split, scene in scenes.items()
    }


def _score(subject: Subject, go_on: Progress) -> list[FeatureScore]:
    config, mae = subject.config, subject.mae
    encoders: dict[str, Encoder] = {THIS: mae_encoder(mae)}
    if subject.beside is not None:
        encoders[BESIDE] = mae_encoder(subject.beside)
    encoders |= {RANDOM: random_encoder(mae, config.seed), RAW: encode_pixels}
    seen = {}
    for split, frames in subject.splits.items():
        rng = make_rng(config.seed, "features", split)
        num_frames = config.frames * (TRAIN_SHARE if split == "train" else 1)
        numbers = choose_frames(rng, frames.shards.frames, num_frames)
        seen[split] = see_frames(frames, numbers, encoders, go_on)
    return score_features(seen["train"], seen["test"], config.seed)


def _model_splits(subject: Subject) -> dict[str, str]:
    """The split of each furniture model that the dataset's scenes have on record."""
    shards = subject.splits["test"].shards
    names = {scene for split in shards.manifest.splits.values() for scene in split.scenes}
    return {record.model: record.split for name in names for record in shards.scene(name).models}


def _summary(
    config: ProbeConfig, grounding: Grounding | None, scores: Sequence[FeatureScore]
) -> dict[str, Any]:
    return {
        "config": config_to_dict(config),
        "grounding": None if grounding is None else dataclasses.asdict(grounding.numbers),
        "features": [dataclasses.asdict(score) for score in scores],
    }


def _write_table(path: Path, table: pa.Table) -> None:
    with atomic.atomic_path(path) as temporary:
        pq.write_table(table, temporary)


class _Count:
    """Frames read so far, over all parts."""

    def __init__(self, subject: Subject, progress: Progress) -> None:
        frames = {split: min(len(held), subject.config.frames) for split, held in subject.splits.items()}
        self._total = sum(frames.values()) if subject.mae.config.target == "depth" else 0
        self._total += frames["test"] + min(len(subject.splits["train"]), TRAIN_SHARE * subject.config.frames)
        self._progress, self._before = progress, 0

    def go_on(self, done: int, total: int) -> None:
        """One part has read ``done`` of its ``total`` frames."""
        self._progress(min(self._before + done, self._total - 1), self._total)
        if done == total:
            self._before += total

    def finish(self) -> None:
        """Everything has been read."""
        self._progress(self._total, self._total)
