"""What ``langwm probe-mae`` does: measure, sum up, write tables and a page.

Owns the order of the parts and the files. What is probed is opened in ``subject``; numbers come from the
modules beside it.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from langwm_data import atomic
from langwm_data.claim import Kind, claim_output
from langwm_data.config_io import config_to_dict
from langwm_data.seeding import make_rng
from pretrain.config import ProbeConfig
from pretrain.language import FrozenText
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
from pretrain.probing.subject import Subject, open_subject, split_of
from pretrain.train import usable_device

ROWS_FILE, FEATURES_FILE, SUMMARY_FILE = "probe.parquet", "features.parquet", "probe.json"
_KIND = Kind(writes=(ROWS_FILE, FEATURES_FILE, SUMMARY_FILE, REPORT_FILE))
TRAIN_SHARE = 4
"""So many times more training than test frames are read for the features."""
THIS, RANDOM, RAW, BESIDE = "this model", "random encoder", "raw frame", "the other run"

Progress = Callable[[int, int], None]


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
    usable_device(config.device)
    subject = open_subject(config)
    text, scenes = None, None
    if subject.mae.config.target == "depth":
        text = FrozenText(subject.mae.text, config.device)
        scenes = _hide(subject, text)
    reads = (config.run, config.beside, config.data, *config.others)
    claim_output(out, config, _KIND, fresh=fresh, reads=reads)
    count = _Count(subject, progress)
    grounding, pictures = None, None
    if text is not None and scenes is not None:
        measured = _ground(subject, text, scenes, count.go_on)
        rows = [result.to_table(frames=title, split=split_of(title)) for title, result in measured.items()]
        _write_table(out / ROWS_FILE, pa.concat_tables(rows))
        grounding = sum_up(measured, subject.about, subject.model_splits, config.seed)
        pictures = draw_grounding(subject.mae, text, grounding, config.seed)
    scores = _score(subject, count.go_on)
    _write_table(out / FEATURES_FILE, pa.Table.from_pylist([dataclasses.asdict(s) for s in scores]))
    atomic.write_json(out / SUMMARY_FILE, _summary(config, grounding, scores))
    atomic.write_text(out / REPORT_FILE, render_report(config, pictures, scores))
    count.finish()
    return out / REPORT_FILE


def _hide(subject: Subject, text: FrozenText) -> dict[str, ProbeScene]:
    config = subject.config
    return {
        title: make_probe_scene(frames, text, subject.objects, num_frames=config.frames, seed=config.seed)
        for title, frames in subject.shown.items()
    }


def _ground(
    subject: Subject, text: FrozenText, scenes: dict[str, ProbeScene], go_on: Progress
) -> dict[str, GroundingResult]:
    mae = subject.mae
    prior = DepthPrior.of(subject.splits["train"], mae.config.max_depth_m)
    return {
        title: measure_grounding(mae, text, scene, prior, seed=subject.config.seed, progress=go_on)
        for title, scene in scenes.items()
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
        limit, is_told = subject.config.frames, subject.mae.config.target == "depth"
        self._total = sum(min(len(held), limit) for held in subject.shown.values()) if is_told else 0
        self._total += min(len(subject.splits["test"]), limit)
        self._total += min(len(subject.splits["train"]), TRAIN_SHARE * limit)
        self._progress, self._before = progress, 0

    def go_on(self, done: int, total: int) -> None:
        """One part has read ``done`` of its ``total`` frames."""
        self._progress(min(self._before + done, self._total - 1), self._total)
        if done == total:
            self._before += total

    def finish(self) -> None:
        """Everything has been read."""
        self._progress(self._total, self._total)
