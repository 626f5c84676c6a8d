"""What a grid will take: cells, steps, disk, and time as far as cells in its folder tell.

Owns the estimate. Nothing is trained for it: how fast a learner learns here is only known from one that has.
"""

from collections.abc import Sequence
from pathlib import Path

from agent.benchmark.cells import SPLITS, episodes_on, is_done, units_of
from agent.benchmark.grid import Cell, GridConfig, base_config, cell_config, cells_of
from agent.benchmark.record import Record, read_record
from agent.benchmark.run import check_grid, check_learners
from agent.config import AgentConfig
from agent.plan import bytes_a_step
from agent.systems.registry import find_system
from agent.systems.system import Spaces
from langwm_data.baking import open_scenes
from langwm_data.engines import Engine
from langwm_data.shards.summary import format_size


def plan_benchmark(grid: GridConfig, out: Path, *, engine: Engine = "local", workers: int = 1) -> str:
    """A few lines: what there is to do, its size on disk, and how long it takes.

    Raises:
        ConfigError: As the grid itself would.
    """
    check_grid(grid, out, fresh=False)
    if engine == "local":  # as in the run itself
        check_learners(grid)
    cells = cells_of(grid)
    records = {cell: read_record(out, cell) for cell in cells}
    todo = [cell for cell in cells if not is_done(grid, cell, records[cell])]
    learners = [cell for cell in todo if not cell.is_control and records[cell].state != "done"]
    base = base_config(grid)
    lines = [
        f"cells   {len(cells)}: {len(cells) - len(todo)} are done, {len(learners)} are to be trained",
        f"steps   {sum(cell_config(grid, c).steps for c in learners):,} of environments,"
        f" {sum(cell_config(grid, c).num_updates for c in learners):,} updates",
        f"scoring {_episodes(base):,} episodes a cell:"
        f" {' and '.join(f'{episodes_on(base, split)} on each {split} floor' for split in SPLITS)}",
        f"disk    {format_size(sum(_replay_bytes(cell_config(grid, c)) for c in learners))} of replay",
        f"time    {_time(grid, todo, records, workers)}",
    ]
    return "\n".join(lines)


def _episodes(config: AgentConfig) -> int:
    library = open_scenes(config.env.scenes)
    return sum(episodes_on(config, split) * len(library.names(split)) for split in SPLITS)


def _replay_bytes(config: AgentConfig) -> int:
    """What frames, depth and objects take; the few numbers of a step are left out."""
    camera, steps = config.env.camera, min(config.steps, config.replay.capacity_steps)
    frames = Spaces(camera.height, camera.width, task_dim=0, action_dim=0)
    return steps * bytes_a_step(config, find_system(config.system), frames)


def _time(grid: GridConfig, todo: Sequence[Cell], records: dict[Cell, Record], workers: int) -> str:
    """From the seconds that done cells took for each of their units; a system's own where there are any."""
    wanted, seconds = base_config(grid).eval_episodes, 0.0
    rates: dict[str, float] = {}
    for cell, record in records.items():
        if is_done(grid, cell, record):
            rates[cell.system] = sum(record.seconds.values()) / units_of(grid, cell)
        elif record.state == "done":  # only more episodes are to be played
            seconds += record.seconds["score"] * (wanted / record.scored["test"] - 1)
    todo = [cell for cell in todo if records[cell].state != "done"]
    learned = [rate for system, rate in rates.items() if not Cell(system, 0).is_control]
    if not learned and any(not cell.is_control for cell in todo):
        return "not known before a first cell is done: give one with --systems and --seeds, then ask again"
    typical = sum(learned) / len(learned) if learned else 0.0
    seconds += sum(units_of(grid, cell) * rates.get(cell.system, typical) for cell in todo)
    others = len({cell.system for cell in todo} - set(rates))
    guess = f"; {others} systems without a done cell are taken as the mean of the others" if others else ""
    return f"{seconds / workers / 3600:.1f} h with {workers} cells at a time{guess}"
