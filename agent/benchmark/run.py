"""Does the cells of a grid, here or on a Ray cluster, and says which of them failed.

Owns the order of events. Whatever happens, the same command goes on from what is there.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import torch

from agent.benchmark.cells import CellWorker, is_done, units_of
from agent.benchmark.grid import (
    EPISODES,
    Cell,
    GridConfig,
    base_config,
    cell_config,
    cells_of,
    known_systems,
)
from agent.benchmark.record import Record, read_record, write_record
from agent.benchmark.report import LATEX_FILE, MARKDOWN_FILE, PAGE_FILE, write_reports
from agent.config import AgentConfig
from agent.systems.registry import find_system
from agent.systems.system import Spaces
from langwm_data.claim import Kind, check_output, claim_output
from langwm_data.config_io import CONFIG_FILE, ConfigError, config_to_dict, differing_fields, read_mapping
from langwm_data.engines import Engine, Pool, RayPool, check_engine
from langwm_data.workers import WorkerPool
from pretrain.train import usable_device

JOIN_S = 120.0
"""How long interrupted cells may take to save themselves."""
_KIND = Kind(
    writes=(LATEX_FILE, MARKDOWN_FILE, PAGE_FILE, *known_systems()),
    may_differ=("systems", "seeds", "episodes", "mae", "against"),
)
Progress = Callable[[int, int], None]

log = logging.getLogger(__name__)


def run_benchmark(
    grid: GridConfig,
    out: Path,
    *,
    engine: Engine = "local",
    workers: int | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> list[str]:
    """Train and score every cell that is not done, and write tables, curves and a page after each.

    Args:
        grid: Which cells, and what they share. Cells that an earlier call did stay, also those of systems
            and seeds that are not asked for now.
        out: Folder of the grid.
        engine: ``local`` or ``ray``, one task for each cell.
        workers: Cells at a time, each in a process of its own; one after another in this process when None.
            More need a script guarded by ``if __name__ == "__main__":``.
        fresh: Throw away what ``out`` holds first.
        progress: Called with units of work done and in all: environment steps and scored episodes.

    Returns:
        A sentence for each cell of ``grid`` that failed.

    Raises:
        ConfigError: If the request cannot be carried out; nothing was changed then.
        KeyboardInterrupt: After SIGINT or SIGTERM, once the cells are saved.
    """
    check_engine(engine, workers)
    check_grid(grid, out, fresh=fresh)
    if engine == "local":  # the machines of a cluster may have what this one lacks
        check_learners(grid)
    claim_output(out, grid, _KIND, fresh=fresh, reads=_reads(grid))
    cells = cells_of(grid)
    todo = [cell for cell in cells if not is_done(grid, cell, read_record(out, cell))]
    if todo:
        most = None if workers is None else min(workers, len(todo))
        _do(grid, out, cells, todo, _pool(grid, out, engine, most), progress)
    write_reports(out)
    return failures(out, cells)


def failures(out: Path, cells: Sequence[Cell]) -> list[str]:
    """A sentence for each of the cells that failed."""
    records = [(cell, read_record(out, cell)) for cell in cells]
    return [f"{cell.name}: {record.cause}" for cell, record in records if record.state == "failed"]


def check_grid(grid: GridConfig, out: Path, *, fresh: bool) -> None:
    """Refuse what cannot work, before anything is written.

    Raises:
        ConfigError: If a cell cannot be trained so, or ``out`` holds another grid or cells that were
            trained otherwise.
    """
    if unwanted := [system for system in grid.mae if system not in grid.systems]:
        raise ConfigError(f"--mae names a run for {unwanted[0]}, which is not among the systems")
    wanted = base_config(grid).eval_episodes
    for cell in cells_of(grid):
        config = None if cell.is_control else cell_config(grid, cell)
        if not fresh:
            _check_begun(cell, config, wanted, out)
    check_output(out, grid, _KIND, fresh=fresh, reads=_reads(grid))


def _reads(grid: GridConfig) -> list[str | None]:
    return [*grid.mae.values(), *base_config(grid).env.scenes.folders]


def _check_begun(cell: Cell, config: AgentConfig | None, wanted: int, out: Path) -> None:
    """Refuse a cell that was begun as another one, or scored on more episodes than are wanted."""
    scored = read_record(out, cell).scored.get("test", 0)
    if scored > wanted:
        raise ConfigError(
            f"{cell.name} of --out {str(out)!r} is scored on {scored} episodes a test floor already;"
            f" --episodes {wanted} must be as many or more"
        )
    held = cell.folder(out) / CONFIG_FILE
    if config is None or not held.is_file():
        return
    old, new = read_mapping(held), config_to_dict(config)
    if fields := differing_fields(old | {EPISODES: wanted}, new):
        raise ConfigError(
            f"{cell.name} of --out {str(out)!r} was begun with another configuration:"
            f" {'; '.join(fields)}; use another folder, or --fresh to start over"
        )


def check_learners(grid: GridConfig) -> None:
    """Make each learner once, and refuse what cannot be made.

    Raises:
        ConfigError: Naming the learner and why.
    """
    for cell in cells_of(grid):
        if cell.is_control or cell.seed != grid.seeds[0]:
            continue
        config = cell_config(grid, cell)
        usable_device(config.device)
        system = find_system(cell.system)
        if system.reads_mae and config.features == "frozen" and config.mae is None:
            raise ConfigError(
                f"{cell.system} has features 'frozen', which need a pretrained MAE; give"
                f" --mae {cell.system}=RUN, or --set features=finetuned"
            )
        try:
            with contextlib.closing(system.make_env(config)) as env:
                system.create(config, Spaces.of(env))
        except ValueError as error:
            raise ConfigError(f"{cell.system} cannot be trained so: {error}") from error


def _pool(grid: GridConfig, out: Path, engine: Engine, workers: int | None) -> Pool:
    is_apart = engine == "ray" or workers is not None
    threads = min(torch.get_num_threads(), max(1, (os.cpu_count() or 1) // (workers or 1)))
    worker = CellWorker(
        grid=grid,
        out=out.absolute(),
        folder=Path.cwd(),
        threads=threads if engine == "local" and is_apart else None,
        finish=write_reports,
    )
    if engine == "ray":
        num_gpus = int(base_config(grid).device.startswith("cuda"))
        return RayPool(worker, tasks_per_worker=1, num_gpus=num_gpus)
    return WorkerPool(worker, workers or 1, tasks_per_worker=1, is_separate=is_apart, join_s=JOIN_S)


def _do(
    grid: GridConfig,
    out: Path,
    cells: Sequence[Cell],
    todo: Sequence[Cell],
    pool: Pool,
    progress: Progress | None,
) -> None:
    total = sum(units_of(grid, cell) for cell in cells)
    done = total - sum(units_of(grid, cell) for cell in todo)

    def report(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(min(done, total), total)

    def lost(cell: Cell, sentence: str) -> None:
        log.warning("%s failed: %s", cell.name, sentence)
        record: Record = replace(read_record(out, cell), state="failed", cause=sentence)
        write_record(out, cell, record)
        report(units_of(grid, cell))

    report(0)
    if len(todo) < len(cells):
        log.info("%d of %d cells are done; going on with the rest", len(cells) - len(todo), len(cells))
    with pool:
        pool.run(list(todo), report, lost)
