"""Folders of grids as cells leave them, without any learning."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agent.benchmark.grid import Request, base_config, cell_config, make_grid
from agent.benchmark.record import Record, write_record
from langwm_data import atomic
from langwm_data.config_io import config_to_yaml

TEST_FLOORS = ("Maple_0", "Maple_1", "Rowan_0")
TRAIN_FLOORS = ("Alder_0", "Hazel_1")
MACHINE = {
    "processor": "Abacus 9000",
    "cores": 2,
    "threads": 1,
    "memory_gib": 4.0,
    "python": "3",
    "torch": "2",
}


def make_rows(system, seed, rate, count=20):
    """Episodes that succeed at a rate; the same ones, easy and hard, for every system and seed."""
    rng, hard = np.random.default_rng([seed, *map(ord, system)]), np.random.default_rng(7)
    rows = []
    for split, floors in (("test", TEST_FLOORS), ("train", TRAIN_FLOORS)):
        for floor in floors:
            for number in range(count):
                ease = hard.random()
                wins = bool((ease if rng.random() < 0.6 else rng.random()) < rate)
                rows.append(
                    {
                        "system": system,
                        "split": split,
                        "scene": floor,
                        "tier": number % 2,
                        "episode": number,
                        "success": wins,
                        "spl": wins * rng.uniform(0.5, 1.0),
                        "soft_spl": rng.uniform(0.0, 1.0),
                        "distance_to_goal": rng.uniform(0.0, 4.0),
                        "collisions": int(rng.integers(10)),
                        "length": 50,
                        "task": f"{split} {floor} {number}",
                    }
                )
    return rows


def write_cell(out, grid, cell, rate=0.5, *, record=None, rows=None, steps=None):
    """What a cell that is done leaves behind."""
    folder = cell.folder(out)
    rows = make_rows(cell.system, cell.seed, rate) if rows is None else rows
    if rows:
        with atomic.atomic_path(folder / "eval/episodes.parquet") as temporary:
            pq.write_table(pa.Table.from_pylist(rows), temporary)
    if not cell.is_control:
        config = cell_config(grid, cell)
        atomic.write_text(folder / "config.yaml", config_to_yaml(config))
        rng = np.random.default_rng(cell.seed)
        lines = [
            {"step": step, "env/success": float(rng.random() < rate * step / config.steps)}
            | {"env/soft_spl": rate * step / config.steps, "env/return": rng.normal() + step / config.steps}
            for step in range(40, 1 + (steps or config.steps), 40)
        ]
        atomic.write_text(folder / "metrics.jsonl", "".join(json.dumps(row) + "\n" for row in lines))
    seconds = {"score": 60.0} if cell.is_control else {"train": 360.0, "score": 180.0}
    whole = Record(
        state="done",
        seconds=seconds,
        cpu_seconds=seconds,
        scored={"test": 20, "train": 20},
        updates=0 if cell.is_control else 1900,
        parameters=0 if cell.is_control else 2_500_000,
        machine=MACHINE,
    )
    write_record(out, cell, record or whole)


def begin_grid(out, systems=None, seeds="0-1", **request):
    """A folder that was claimed, with no cell in it."""
    assignments = ["steps=4000", "eval_episodes=20", "env.distance_edges_m=[1,3,6]", "features=finetuned"]
    grid = make_grid(Request(systems=systems, seeds=seeds, **request), assignments=assignments)
    atomic.write_text(out / "config.yaml", config_to_yaml(grid))
    assert base_config(grid).steps == 4000
    return grid
