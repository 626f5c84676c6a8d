"""What lies in the folder of a grid, finished or not, as arrays that statistics can be taken of.

Reads only what cells left: records, ``eval/episodes.parquet``, ``metrics.jsonl``, ``config.yaml``.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Bool, Float64, Int64, Shaped

from agent.benchmark.grid import Cell, GridConfig, base_config, is_grid
from agent.benchmark.record import Record, read_record, record_path
from agent.benchmark.rows import in_table_order
from agent.config import AgentConfig
from agent.evaluate import EVAL_FOLDER
from agent.scoring.rows import EPISODES_FILE
from langwm_data.config_io import CONFIG_FILE, ConfigError, load_config_file
from pretrain.metrics import read_metrics

MEASURES = ("success", "spl", "soft_spl", "distance_to_goal", "collisions", "length")
KEYS = ("scene", "episode", "task")
"""Columns that tell the episodes of a split apart: place, number, and checksum of what is to be done."""


@dataclass(frozen=True, kw_only=True)
class Played:
    """The fixed episodes of one split as one system played them, with every seed that did."""

    system: str
    seeds: tuple[int, ...]
    scene: Shaped[np.ndarray, " E"]
    """Floor of each episode."""
    episode: Int64[np.ndarray, " E"]
    """Number of each episode on its floor or in its split."""
    task: Shaped[np.ndarray, " E"]
    """Checksum of what is to be done in each episode."""
    tier: Int64[np.ndarray, " E"]
    """Distance tier."""
    values: Mapping[str, Float64[np.ndarray, "S E"]]
    """By measure, for every seed and episode."""

    def where(self, keep: Bool[np.ndarray, " E"]) -> "Played":
        """Some of the episodes."""
        return Played(
            system=self.system,
            seeds=self.seeds,
            scene=self.scene[keep],
            episode=self.episode[keep],
            task=self.task[keep],
            tier=self.tier[keep],
            values={name: values[:, keep] for name, values in self.values.items()},
        )


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """One cell, as far as it is."""

    cell: Cell
    record: Record
    config: AgentConfig | None
    """None of controls, and before training has begun."""
    metrics: Sequence[Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Results:
    """A grid, as far as it is."""

    grid: GridConfig
    base: AgentConfig
    cells: Sequence[CellResult]
    played: Mapping[str, Mapping[str, Played]]
    """By split, then by system in the order of the table."""

    @property
    def systems(self) -> list[str]:
        """Of all cells, in the order of the table."""
        return in_table_order({result.cell.system for result in self.cells})

    def of(self, system: str) -> list[CellResult]:
        """The cells of a system, by seed."""
        return [result for result in self.cells if result.cell.system == system]


def read_results(out: Path) -> Results:
    """Read the folder of a grid.

    Raises:
        ConfigError: If it holds no grid, or a file of it is damaged.
    """
    if not is_grid(out):
        raise ConfigError(f"{str(out)!r} holds no grid; give the --out of a benchmark")
    grid = load_config_file(GridConfig, out / CONFIG_FILE)
    cells = [_read_cell(out, cell) for cell in _find_cells(out)]
    tables = {result.cell: _read_rows(out, result) for result in cells}
    played: dict[str, dict[str, Played]] = {}
    for split in ("test", "train"):
        played[split] = {}
        for system in in_table_order({result.cell.system for result in cells}):
            found = {
                cell.seed: table.filter(pc.field("split") == split)
                for cell, table in tables.items()
                if cell.system == system and split in read_record(out, cell).scored
            }
            if found:
                played[split][system] = _stack(system, found)
    return Results(grid=grid, base=base_config(grid), cells=cells, played=played)


def _find_cells(out: Path) -> list[Cell]:
    """By the records that are there."""
    found = []
    for path in out.glob("*/seed-*.json"):
        if match := re.fullmatch(r"seed-(\d+)\.json", path.name):
            found.append(Cell(path.parent.name, int(match[1])))
    return sorted(found)


def _read_cell(out: Path, cell: Cell) -> CellResult:
    path = cell.folder(out) / CONFIG_FILE
    return CellResult(
        cell=cell,
        record=read_record(out, cell),
        config=load_config_file(AgentConfig, path) if path.is_file() else None,
        metrics=read_metrics(cell.folder(out)),
    )


def _read_rows(out: Path, result: CellResult) -> pa.Table:
    """The rows of the cell's own system, whatever else was scored beside it."""
    path, names = result.cell.folder(out) / EVAL_FOLDER / EPISODES_FILE, ["system", "split", "tier"]
    names += [*KEYS, *MEASURES]
    if not path.is_file():
        return pa.table({name: pa.array([], pa.string()) for name in names})
    try:
        table = pq.read_table(path, columns=names)
    except pa.ArrowException as error:
        raise ConfigError(
            f"{path} is damaged; remove {record_path(out, result.cell)} to score again"
        ) from error
    return table.filter(pc.field("system") == result.cell.system)


def _stack(system: str, tables: Mapping[int, pa.Table]) -> Played:
    """Put seeds beside one another, on the episodes that all of them have played so far.

    Raises:
        ValueError: If one played something else under the same number, or nothing that the others did.
    """
    tasks = sorted(_shared_tasks(system, tables))
    order: list[tuple[str, Literal["ascending", "descending"]]] = [(key, "ascending") for key in KEYS]
    ordered = {
        seed: table.filter(pc.field("task").isin(tasks)).sort_by(order) for seed, table in tables.items()
    }
    one = next(iter(ordered.values()))
    values = {
        name: np.array([table[name].to_numpy().astype(np.float64) for table in ordered.values()])
        for name in MEASURES
    }
    return Played(
        system=system,
        seeds=tuple(ordered),
        scene=np.array(one["scene"].to_pylist(), dtype=np.str_),
        episode=one["episode"].to_numpy(),
        task=np.array(one["task"].to_pylist(), dtype=np.str_),
        tier=one["tier"].to_numpy(),
        values=values,
    )


def _shared_tasks(system: str, tables: Mapping[int, pa.Table]) -> set[str]:
    """What all seeds have played."""
    keys = {
        seed: set(zip(*(table[key].to_pylist() for key in KEYS), strict=True))
        for seed, table in tables.items()
    }
    first, common = next(iter(keys.values())), set.intersection(*keys.values())
    for seed, own in list(keys.items())[1:]:
        numbers = [{(scene, episode) for scene, episode, _ in some} for some in (first, own)]
        if not common or len(numbers[0] & numbers[1]) > len(first & own):
            raise ValueError(f"{system}/seed-{seed} was scored on other episodes than the seeds before it")
    return {task for *_, task in common}
