"""The pretraining loop: batches in, checkpoints, metrics, pictures and the finished model out."""

import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from langwm_data import atomic
from langwm_data.claim import Kind, check_output, claim_output
from langwm_data.config_io import CONFIG_FILE, ConfigError
from langwm_data.png import encode_png
from langwm_data.shards.dataset import ShardDataset
from pretrain.average import WeightAverage
from pretrain.batch import MAEBatch
from pretrain.checkpoint import CHECKPOINTS, latest_checkpoint, load_checkpoint, save_checkpoint
from pretrain.config import PretrainConfig
from pretrain.dataset import FrameDataset, batch_numbers, open_split
from pretrain.interrupt import stop_requests
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.metrics import METRICS_FILE, TENSORBOARD, MetricsLogger
from pretrain.model_file import MODEL_FOLDER, Intrinsics
from pretrain.optim import Optimizer
from pretrain.pictures import mae_panel
from pretrain.team import Team, check_shares, joined_team, own_device
from pretrain.update import batch_rngs, mae_update, make_mae_batch, torch_seed
from pretrain.validation import make_validation_batch, validate

log = logging.getLogger(__name__)

PICTURES = "pictures"
_KIND = Kind(writes=(METRICS_FILE, TENSORBOARD, PICTURES, CHECKPOINTS, MODEL_FOLDER), may_differ=("steps",))
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class _Frames:
    """What there is to learn from."""

    train: FrameDataset
    valid: FrameDataset | None
    fingerprint: str
    """Of the dataset."""


@dataclass(kw_only=True)
class _Learner:
    """What learns, and how far it is."""

    mae: LanguageGroundedMAE
    optimizer: Optimizer
    average: WeightAverage
    step: int = 0


def pretrain_mae(
    config: PretrainConfig, data: Path, out: Path, *, fresh: bool = False, progress: Progress | None = None
) -> Path:
    """Pretrain the autoencoder on a rendered dataset, going on where an earlier call stopped.

    An interrupted run ends with the same weights as an uninterrupted one. A run may be continued with
    more steps, also after its end. At a constant learning rate that, too, gives what the longer run
    would have given in one go. A cosine follows the curve of the new length from there on, so the
    learning rate rises once where the old curve was left; the metrics have it step by step.

    Started by ``torchrun`` or ``accelerate launch``, all processes share each batch; the first of them
    writes. With dropout off they learn what one process would, up to rounding.

    Args:
        config: Everything about the run.
        data: Folder of the dataset.
        out: Folder of the run.
        fresh: Throw away what ``out`` holds first.
        progress: Called with steps done and steps in all.

    Returns:
        ``out``; ``LanguageGroundedMAE.from_pretrained`` reads it.

    Raises:
        ConfigError: If data, text encoder, device or ``out`` cannot be used; nothing was changed then.
        ValueError: If the last checkpoint is damaged.
        KeyboardInterrupt: After SIGINT or SIGTERM, once everything is saved.
        FloatingPointError: If training diverges.
    """
    with joined_team() as team:
        check_shares(config.batch_size, config.optimizer.accumulate, team)
        frames = _open_frames(config, data)
        text = FrozenText(config.text, usable_device(own_device(config.device)))
        reads = (data, config.text.model)
        check_output(out, config, _KIND, fresh=fresh, reads=reads)
        held = None if fresh else _load(out, frames.fingerprint, own_device(config.device))
        team.wait()  # before the first begins a fresh run
        if held is not None:
            config = replace(config, steps=max(config.steps, held[0]))  # what is done stays done
        if team.is_first:
            claim_output(out, config, _KIND, fresh=fresh, reads=reads)
        learner = _make_learner(config, text, frames.train.intrinsics, held)
        if learner.step >= config.steps:
            log.info("%s has finished its %d steps; --fresh starts over", out, learner.step)
            return out
        make = partial(_make_batch, config, frames.train, text, team)
        with _make_keeper(config, out, frames, text, team, learner.step) as keeper, stop_requests() as stop:
            with _prefetched(make, range(learner.step, config.steps)) as batches:
                while learner.step < config.steps and not team.any(stop.is_set(), learner.mae.device):
                    keeper.look(learner, _step(config, learner, batches, team))
                    if progress is not None and team.is_first:
                        progress(learner.step, config.steps)
            keeper.save(learner)
        if learner.step < config.steps:
            raise KeyboardInterrupt
    return out


def usable_device(name: str) -> torch.device:
    """The device called ``name``.

    Raises:
        ConfigError: If PyTorch knows no such device or cannot use it here.
    """
    try:
        return torch.empty(0, device=name).device
    except (RuntimeError, AssertionError) as error:
        raise ConfigError(f"device {name!r} cannot be used on this machine; cpu always can") from error


def _open_frames(config: PretrainConfig, data: Path) -> _Frames:
    size = (config.mae.height, config.mae.width)
    train, valid = (open_split(data, split, size, config.ram_mib) for split in ("train", "test"))
    if train is None:
        raise ConfigError(f"--data {str(data)!r} has no training frames")
    if config.objects.captions != "none" and not any(train.objects):
        raise ConfigError(
            f"--data {str(data)!r} has no captions: no training frame shows an object that is worth one;"
            " allowed: a dataset that has some, or objects.captions=none"
        )
    return _Frames(train=train, valid=valid, fingerprint=ShardDataset(data).manifest.fingerprint)


def _make_batch(
    config: PretrainConfig, train: FrameDataset, text: FrozenText, team: Team, step: int
) -> MAEBatch:
    numbers = batch_numbers(config.seed, step, config.batch_size, len(train))
    rows = team.rows(config.batch_size)
    seen = train.batch(numbers[rows.start : rows.stop])
    return make_mae_batch(batch_rngs(config.seed, step, rows), seen, text, config.objects, config.augment)


def _make_learner(
    config: PretrainConfig,
    text: FrozenText,
    intrinsics: Intrinsics,
    held: tuple[int, dict[str, Any]] | None,
) -> _Learner:
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "weights"))
        mae = LanguageGroundedMAE(config.mae, config.text, text.null_text).to(own_device(config.device))
    mae.intrinsics = intrinsics
    learner = _Learner(
        mae=mae,
        optimizer=Optimizer(mae, config.optimizer, config.steps),
        average=WeightAverage(mae, config.optimizer.ema_decay),
    )
    if held is not None:
        learner.step, state = held
        try:
            learner.mae.load_state_dict(state["mae"])
            learner.optimizer.load_state_dict(state["optimizer"])
            learner.average.load_state_dict(state["average"])
        except (KeyError, RuntimeError, ValueError) as error:
            raise ConfigError(
                f"the last checkpoint, of step {learner.step}, is of another architecture than {CONFIG_FILE}"
                " asks for; use the configuration that it was made with, or --fresh to start over"
            ) from error
    if config.optimizer.is_compiled:
        mae.compile()
    return learner


def _save(learner: _Learner, out: Path, fingerprint: str) -> int:
    state = {
        "mae": learner.mae.state_dict(),
        "optimizer": learner.optimizer.state_dict(),
        "average": learner.average.state_dict(),
        "data_fingerprint": fingerprint,
    }
    learner.average.model.save_pretrained(out / MODEL_FOLDER)
    save_checkpoint(out, learner.step, state)
    return learner.step


def _load(out: Path, fingerprint: str, device: str) -> tuple[int, dict[str, Any]] | None:
    folder = latest_checkpoint(out)
    if folder is None:
        return None
    step, state = load_checkpoint(folder, device)
    if state.get("data_fingerprint") != fingerprint:
        raise ConfigError(
            f"--out {str(out)!r} was trained on another dataset than --data;"
            " use another folder, the same dataset, or --fresh to start over"
        )
    return step, state


def _step(
    config: PretrainConfig, learner: _Learner, batches: Iterator[MAEBatch], team: Team
) -> dict[str, float]:
    start = time.perf_counter()
    batch = next(batches)
    waited = time.perf_counter() - start
    metrics = mae_update(
        learner.mae, learner.optimizer, batch, seed=config.seed, step=learner.step, team=team
    )
    learner.average.follow(learner.mae)
    learner.step += 1
    elapsed = time.perf_counter() - start
    speed = {"perf/images_per_s": config.batch_size / elapsed, "perf/data_wait_share": waited / elapsed}
    return metrics | speed


def _held_out(config: PretrainConfig, valid: FrameDataset | None, text: FrozenText) -> MAEBatch | None:
    if valid is None:
        log.info("the dataset has no test frames: training goes unwatched")
        return None
    return make_validation_batch(
        valid, text, config.objects, num_frames=config.valid_frames, seed=config.seed
    )


class _Keeper:
    """Writes what is left of a run: metrics, looks at held-out frames, pictures, checkpoints."""

    def __init__(
        self,
        config: PretrainConfig,
        out: Path,
        fingerprint: str,
        held_out: MAEBatch | None,
        logger: MetricsLogger,
    ) -> None:
        self._config = config
        self._out = out
        self._fingerprint = fingerprint
        self._held_out = held_out
        self._logger = logger
        self._saved = -1

    def look(self, learner: _Learner, metrics: dict[str, float]) -> None:
        """Do what is due after this step."""
        step, config = learner.step, self._config
        is_last = step == config.steps
        is_seen = self._held_out is not None and (step % config.valid_every == 0 or is_last)
        if is_seen:
            metrics = metrics | self._validate(learner)
        if is_seen or step % config.log_every == 0 or step == 1 or is_last:
            self._logger.log(step, metrics)
        if step % config.checkpoint_every == 0:
            self.save(learner)

    def save(self, learner: _Learner) -> None:
        """Write model and checkpoint, unless those of this step are there."""
        if self._saved != learner.step:
            self._saved = _save(learner, self._out, self._fingerprint)

    def _validate(self, learner: _Learner) -> dict[str, float]:
        assert self._held_out is not None
        found, predicted = validate(learner.average.model, self._held_out, self._config.seed)
        panel = mae_panel(self._held_out, predicted.numpy(), self._config.mae.max_depth_m)
        atomic.write_bytes(self._out / PICTURES / f"step-{learner.step:09d}.png", encode_png(panel))
        self._logger.image(learner.step, "valid/panel", panel)
        return found


class _Bystander:
    """In the place of a ``_Keeper`` for the members of a team that write nothing."""

    def look(self, learner: _Learner, metrics: dict[str, float]) -> None:
        """Nothing."""

    def save(self, learner: _Learner) -> None:
        """Nothing."""


@contextmanager
def _make_keeper(
    config: PretrainConfig, out: Path, frames: _Frames, text: FrozenText, team: Team, step: int
) -> Iterator[_Keeper | _Bystander]:
    if not team.is_first:
        yield _Bystander()
        return
    with MetricsLogger(out, step) as logger:
        held_out = _held_out(config, frames.valid, text)
        yield _Keeper(config, out, frames.fingerprint, held_out, logger)


@contextmanager
def _prefetched(make: Callable[[int], MAEBatch], steps: range) -> Iterator[Iterator[MAEBatch]]:
    """Make each step's batch in a thread while the step before is being taken."""
    with ThreadPoolExecutor(max_workers=1) as pool:

        def iterate() -> Iterator[MAEBatch]:
            coming = pool.submit(make, steps[0])
            for step in steps:
                batch = coming.result()
                if step + 1 in steps:
                    coming = pool.submit(make, step + 1)
                yield batch

        yield iterate()
