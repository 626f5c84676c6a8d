"""One cell of a grid: train, score on both splits, remember what it took and how it ended.

A cell that fails is a result as well: its cause is written down, and nothing is raised that would stop the
other cells.
"""

import contextlib
import logging
import math
import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import safe_open

from agent.benchmark.grid import Cell, GridConfig, base_config, cell_config
from agent.benchmark.record import Record, Stopwatch, describe_machine
from agent.config import AgentConfig, EnvConfig
from agent.envs.episode_file import make_episode_set
from agent.evaluate import EVAL_FOLDER, evaluate_run
from agent.scoring.players import control_player
from agent.scoring.playing import keep_rows, play_all
from agent.scoring.rows import claimed
from agent.systems.agent import WEIGHTS_FILE
from agent.train import train_agent
from langwm_data.baking import open_scenes
from langwm_data.scenes.spec import Split
from langwm_data.workers import Report
from pretrain.checkpoint import latest_checkpoint, load_checkpoint
from pretrain.model_file import MODEL_FOLDER

SPLITS: tuple[Split, ...] = ("test", "train")

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CellWorker:
    """Makes the worker of a process that does cells; picklable.

    Args:
        grid: What all cells share.
        out: Folder of the grid.
        folder: The working directory, from which relative paths lead.
        threads: Of PyTorch in each process; as they are when None.
        finish: Called with ``out`` after every cell.
    """

    grid: GridConfig
    out: Path
    folder: Path
    threads: int | None
    finish: Callable[[Path], object]

    @contextlib.contextmanager
    def __call__(self) -> Iterator[Callable[[Cell, Report], None]]:
        """The worker, as a pool wants it."""
        os.chdir(self.folder)
        if self.threads is not None:
            torch.set_num_threads(self.threads)
        yield self._work

    def _work(self, cell: Cell, report: Report) -> None:
        try:
            run_cell(self.grid, cell, self.out, report)
        except KeyboardInterrupt:
            if multiprocessing.parent_process() is None:
                raise
            raise SystemExit(128 + signal.SIGINT) from None  # the parent says what there is to say
        try:
            self.finish(self.out)
        except ValueError as error:  # what is wrong with the tables is no reason not to do the other cells
            log.warning("no tables yet: %s", one_sentence(error))


def run_cell(grid: GridConfig, cell: Cell, out: Path, report: Report) -> None:
    """Bring a cell to its end, from where it stands; ``report`` is told of units of work.

    Raises:
        KeyboardInterrupt: After SIGINT or SIGTERM, once everything is saved.
        BrokenPipeError: If nobody listens to ``report`` any more.
    """
    watch, count = Stopwatch(out, cell), _Count(report, units_of(grid, cell))
    try:
        watch.update(state="unfinished", cause="", details="")
        _run(grid, cell, out, watch, count)
        watch.update(state="done")
    except BrokenPipeError:
        raise
    except Exception as error:
        log.warning("%s failed: %s", cell.name, one_sentence(error))
        watch.update(state="failed", cause=one_sentence(error), details=traceback.format_exc())
    count(units_of(grid, cell))


def units_of(grid: GridConfig, cell: Cell) -> int:
    """Environment steps of training and episodes of scoring that a cell takes."""
    config = base_config(grid)
    episodes = sum(episodes_on(config, split) * n for split, n in _num_floors(config).items())
    return episodes if cell.is_control else config.steps + episodes


def episodes_on(config: AgentConfig, split: Split) -> int:
    """Episodes on each floor: on the training floors together half as many as on the test floors together."""
    if split == "test":
        return config.eval_episodes
    floors = _num_floors(config)
    return max(1, config.eval_episodes * floors["test"] // (2 * floors["train"]))


def is_done(grid: GridConfig, cell: Cell, record: Record) -> bool:
    """Whether a cell is trained and scored on all episodes that are asked for now."""
    config = base_config(grid)
    return record.state == "done" and all(record.scored.get(s, 0) >= episodes_on(config, s) for s in SPLITS)


def one_sentence(error: BaseException) -> str:
    """What went wrong, on one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}".rstrip(": ")


class _Count:
    """Turns how far a cell is into how much was done since, up to all that there is."""

    def __init__(self, report: Report, total: int) -> None:
        self._report = report
        self._total = total
        self._done = 0

    def __call__(self, done: int) -> None:
        done = min(done, self._total)
        if done > self._done:
            self._report(done - self._done)
            self._done = done


def _run(grid: GridConfig, cell: Cell, out: Path, watch: Stopwatch, count: _Count) -> None:
    folder, config = cell.folder(out), base_config(grid) if cell.is_control else cell_config(grid, cell)
    watch.update(machine=describe_machine(config.device))
    start = 0

    def tick(done: int, _: int) -> None:
        watch.tick()
        count(start + done)

    if not cell.is_control:
        with watch.measure("train"):
            train_agent(config, folder, progress=tick)
        watch.update(updates=_num_updates(folder), parameters=_num_parameters(folder))
        start = config.steps
    for split in SPLITS:
        with watch.measure("score"):
            start += _score(cell, config, folder, split, watch, tick)
        count(start)


def _score(
    cell: Cell,
    config: AgentConfig,
    folder: Path,
    split: Split,
    watch: Stopwatch,
    progress: Callable[[int, int], None],
) -> int:
    """Play the fixed episodes of a split unless that is done; how many they are."""
    each = episodes_on(config, split)
    if watch.record.scored.get(split) != each:
        if cell.is_control:
            _play_control(cell.system, config.env, folder / EVAL_FOLDER, split, each, progress)
        else:
            evaluate_run(folder, split=split, episodes_per_scene=each, controls=(), progress=progress)
        watch.update(scored=watch.record.scored | {split: each})
    return each * _num_floors(config)[split]


def _play_control(
    system: str,
    env: EnvConfig,
    out: Path,
    split: Split,
    each: int,
    progress: Callable[[int, int], None],
) -> None:
    """Play the fixed episodes of a split that are not played yet; rows of the other one stay."""
    player, episodes = control_player(system, env, out), make_episode_set(env, split, each)
    with claimed(out):
        rows = play_all((player,), episodes, 1, progress)
        keep_rows(out, (player,), rows[player], episodes)


def _num_floors(config: AgentConfig) -> dict[Split, int]:
    library = open_scenes(config.env.scenes)
    return {split: len(library.names(split)) for split in SPLITS}


def _num_updates(run: Path) -> int:
    """Ordinary updates that a run has taken, as its checkpoint says."""
    folder = latest_checkpoint(run)
    assert folder is not None, run
    return load_checkpoint(folder, torch.device("cpu"))[1]["num_updates"]


def _num_parameters(run: Path) -> int:
    with safe_open(run / MODEL_FOLDER / WEIGHTS_FILE, framework="pt") as file:
        return sum(math.prod(file.get_slice(name).get_shape()) for name in file.keys())  # noqa: SIM118
