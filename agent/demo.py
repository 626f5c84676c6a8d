"""The three stages at one preset, then a report. What ``langwm demo`` calls.

Owns the order of the stages and the clock. Each stage keeps its own state, so the same command goes on
where an earlier one stopped.
"""

import json
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import torch

from agent.config import AgentConfig
from agent.evaluate import EVAL_FOLDER, evaluate_run, read_rows
from agent.report import AGENT, DATA, MAE, PANELS_FILE, PROBE, PROBE_FILE, REPORT_FILE, write_report
from agent.systems.registry import load_agent_config
from agent.train import train_agent
from langwm_data import atomic
from langwm_data.claim import Kind, claim_output
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, config, load_config
from langwm_data.pipeline import render_dataset
from langwm_data.png import encode_png
from pretrain.config import PretrainConfig
from pretrain.dataset import open_split
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.grounding import measure_grounding, predict_with_captions
from pretrain.probing.panels import panel_images, shown_rows
from pretrain.probing.scene import DepthPrior, ProbeScene, make_probe_scene
from pretrain.train import pretrain_mae

log = logging.getLogger(__name__)

Progress = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]
"""Makes a progress display for a unit of work, such as ``frames``."""

CLOCK_FILE = "seconds.json"
_KIND = Kind(writes=(DATA, MAE, PROBE, AGENT, CLOCK_FILE, REPORT_FILE))
PROBE_FRAMES = 400
PANELS = 4
TRAIN_SHARE = 8
"""A training floor gets this many times fewer episodes than a test floor: there are four times as many."""


@config
class DemoConfig:
    """What a demo was asked for; its stages hold their own configurations."""

    preset: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class DemoStages:
    """The configurations of the three stages."""

    dataset: DatasetConfig
    pretrain: PretrainConfig
    agent: AgentConfig


def load_stages(preset: str, seed: int, out: Path) -> DemoStages:
    """Configurations of the three stages at ``preset``, one reading what the other wrote."""
    scenes = {"baked": str(out.absolute() / DATA)}
    agent = {"seed": seed, "mae": str(out.absolute() / MAE), "features": "frozen", "env": {"scenes": scenes}}
    return DemoStages(
        dataset=load_config(DatasetConfig, "langwm_data", presets=[preset], overrides={"seed": seed}),
        pretrain=load_config(PretrainConfig, "pretrain", presets=[preset], overrides={"seed": seed}),
        agent=load_agent_config("langwm", presets=[preset], overrides=agent),
    )


def run_demo(out: Path, *, preset: str, seed: int, workers: int, fresh: bool, progress: Progress) -> Path:
    """Render, pretrain, probe, train, evaluate; write ``report.html``.

    Args:
        out: Folder of the demo; the same call goes on in it.
        preset: Size of all three stages.
        seed: Seed of all three stages.
        workers: Rendering processes.
        fresh: Throw away what an earlier demo left in ``out``.
        progress: Makes a display for each stage.

    Raises:
        ConfigError: If the request is wrong; nothing was changed then.
    """
    stages = load_stages(preset, seed, out)
    claim_output(out, DemoConfig(preset=preset, seed=seed), _KIND, fresh=fresh)
    clock = Clock(out / CLOCK_FILE)
    log.info("1/4 rendering and labelling %d frames", stages.dataset.frames)
    with clock.measure("render"), progress("frames") as show:
        render_dataset(stages.dataset, out / DATA, workers=workers, progress=show)
    log.info("2/4 pretraining the autoencoder for %d steps", stages.pretrain.steps)
    with clock.measure("pretrain"), progress("steps") as show:
        pretrain_mae(stages.pretrain, out / DATA, out / MAE, progress=show)
    with clock.measure("probe"):
        probe(stages.pretrain, out)
    log.info("3/4 training the agent for %d environment steps", stages.agent.steps)
    with clock.measure("train"), progress("environment steps") as show:
        train_agent(stages.agent, out / AGENT, progress=show)
    log.info("4/4 scoring it on fixed episodes")
    with clock.measure("evaluate"):
        evaluate(out / AGENT, stages.agent.eval_episodes, progress)
    return write_report(out, _parts(stages), clock.seconds)


def _parts(stages: DemoStages) -> list[tuple[str, str, str]]:
    pretrain, agent = stages.pretrain, stages.agent
    return [
        ("render", "rendering and labelling", f"{stages.dataset.frames} frames"),
        ("pretrain", "pretraining", f"{pretrain.steps} steps of {pretrain.batch_size} frames"),
        ("probe", "probing captions", f"up to {PROBE_FRAMES} held-out frames, six captions each"),
        ("train", "training the agent", f"{agent.steps} environment steps"),
        ("evaluate", "scoring", "agent and four controls"),
    ]


class Clock:
    """Seconds spent on each stage, kept on disk so that a resumed demo adds up."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.seconds: dict[str, float] = json.loads(path.read_text("utf-8")) if path.is_file() else {}

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to ``stage``, also when it ends in an error."""
        start = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.monotonic() - start
            atomic.write_json(self._path, self.seconds)


def probe(config: PretrainConfig, out: Path) -> None:
    """Measure on held-out frames what captions change; rows and pictures under ``probe/``.

    Raises:
        ConfigError: If the dataset lacks one of the splits.
    """
    if (out / PROBE / PROBE_FILE).is_file():
        return
    size = (config.mae.height, config.mae.width)
    train, test = (open_split(out / DATA, split, size, config.ram_mib) for split in ("train", "test"))
    if train is None or test is None:
        raise ConfigError(
            "the demo needs training and test frames; its preset sets splits.test_fraction to 0 or 1"
        )
    text = FrozenText(config.text, torch.device(config.device))
    mae = LanguageGroundedMAE.from_pretrained(out / MAE).to(config.device)
    scene = make_probe_scene(test, text, config.objects, num_frames=PROBE_FRAMES, seed=config.seed)
    prior = DepthPrior.of(train, config.mae.max_depth_m)
    result = measure_grounding(mae, text, scene, prior, seed=config.seed)
    write_panels(out / PROBE, mae, text, scene, config.seed)
    with atomic.atomic_path(out / PROBE / PROBE_FILE) as temporary:
        pq.write_table(result.to_table(), temporary)


def write_panels(
    folder: Path, mae: LanguageGroundedMAE, text: FrozenText, scene: ProbeScene, seed: int
) -> None:
    """Pictures of some frames, whatever came out for them."""
    panels = []
    for i in shown_rows(scene.batch, PANELS):
        told = scene.claims[i]
        depth_of = predict_with_captions(mae, text, scene, seed, rows=slice(i, i + 1))
        depths = {name: depth[0] for name, depth in depth_of.items() if name in told}
        images = panel_images(scene.batch, i, depths, mae.config.max_depth_m)
        files = {name: f"{i:03d}-{name}.png" for name in images}
        for name, image in images.items():
            atomic.write_bytes(folder / files[name], encode_png(image))
        texts = {name: claim.text for name, claim in told.items() if claim.text}
        panels.append({"key": scene.keys[i], "captions": texts, "images": files})
    atomic.write_json(folder / PANELS_FILE, panels)


def evaluate(run: Path, episodes: int, progress: Progress) -> None:
    """Score agent and controls on the fixed episodes of the test and the training floors.

    Args:
        run: Of the agent.
        episodes: On each test floor.
        progress: Makes a display for each split.
    """
    done = {row["split"] for row in read_rows(run / EVAL_FOLDER)}
    per_floor = {"test": episodes, "train": max(1, episodes // TRAIN_SHARE)}
    for split, count in per_floor.items():
        if split not in done:
            with progress(f"episodes on {split} floors") as show:
                evaluate_run(run, split=split, episodes_per_scene=count, progress=show)
