"""Which weights of the reward let an agent learn to navigate? One system, several weights, the same episodes.

Every run is one of ``train-agent`` in a folder of its own, which goes on where it was stopped. All are scored
on the same fixed episodes; success, SPL and contacts do not depend on the weights. Writes ``rewards.md``,
``rewards.json`` and ``curve.png`` into ``--out``.

    python -m benchmarks.rewards --out runs/rewards --seeds 0 1 --workers 2 --set env.scenes.baked=runs/data
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure

from agent.config import AgentConfig
from agent.evaluate import EVAL_FOLDER, evaluate_run, read_rows
from agent.scoring.statistics import seeds_interval, seeds_rate_interval
from agent.systems.registry import SYSTEMS, load_agent_config
from agent.train import train_agent
from benchmarks.plots import plot_running_mean
from langwm_data import atomic
from langwm_data.config_io import merge, parse_assignment
from langwm_data.seeding import make_rng
from pretrain.metrics import read_metrics

REWARDS: Mapping[str, Mapping[str, float]] = {
    "paper": {"progress": 1.0, "collision": -0.1, "success": 10.0},
    "homes": {"progress": 5.0, "collision": -0.1, "success": 10.0},
    "steeper": {"progress": 10.0, "collision": -0.1, "success": 10.0},
    "contacts-free": {"progress": 5.0, "collision": 0.0, "success": 10.0},
    "progress-only": {"progress": 5.0, "collision": -0.1, "success": 0.0},
    "arrival-only": {"progress": 0.0, "collision": -0.1, "success": 10.0},
}
"""Weights by name; ``paper`` (iGibson's) and ``homes`` are those of the presets."""
SPLITS = ("train", "test")


def run_of(out: Path, reward: str, seed: int) -> Path:
    return out / f"{reward}-{seed}"


def make_config(asked: argparse.Namespace, reward: str, seed: int) -> AgentConfig:
    """The configuration of one run: the preset's but for the weights."""
    overrides: dict[str, Any] = {"seed": seed, "env": {"reward": dict(REWARDS[reward])}}
    for text in asked.set:
        overrides = merge(overrides, parse_assignment(text))
    return load_agent_config(asked.system, presets=[asked.preset], overrides=overrides)


def learn(asked: argparse.Namespace, reward: str, seed: int) -> str:
    """Train one run and score it on both kinds of floors; what is done already is not done again."""
    torch.set_num_threads(1)
    out = run_of(asked.out, reward, seed)
    train_agent(make_config(asked, reward, seed), out)
    for split, episodes in zip(SPLITS, (asked.train_episodes, asked.episodes), strict=True):
        evaluate_run(out, split=split, episodes_per_scene=episodes, controls=())
    return out.name


def score(out: Path, reward: str, seeds: Sequence[int], split: str) -> dict[str, Any]:
    """Over all seeds: success by distance, SPL and contacts, with intervals over seeds and episodes."""
    rows = []
    for seed in seeds:
        own = [row for row in read_rows(run_of(out, reward, seed) / EVAL_FOLDER) if row["split"] == split]
        rows.append(sorted(own, key=lambda row: (row["scene"], row["episode"])))
    rng = make_rng(0, "rewards", reward, split)
    tiers = sorted({row["tier"] for row in rows[0]})
    near = {
        str(tier): seeds_rate_interval(
            np.array([[r["success"] for r in own if r["tier"] == tier] for own in rows], float), rng
        )
        for tier in tiers
    }
    means = {
        name: seeds_interval(np.array([[r[name] for r in own] for own in rows], float), rng)
        for name in ("spl", "collision_rate")
    }
    return {"success": near, **means, "each": [float(np.mean([r["success"] for r in own])) for own in rows]}


def as_table(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown; a row for each reward."""
    heads = ["reward", "progress, collision, success", "training floors, 1-3 m, success %"]
    heads += ["test floors, 1-3 m", "test floors, 3-6 m", "SPL", "steps in contact, %", "each seed, test, %"]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for reward, splits in found.items():
        test = splits["test"]
        cells = [reward, ", ".join(f"{REWARDS[reward][k]:g}" for k in ("progress", "collision", "success"))]
        cells.append(splits["train"]["success"]["0"].as_text(0, 100))
        cells += [interval.as_text(0, 100) for interval in test["success"].values()]
        cells += [test["spl"].as_text(2), test["collision_rate"].as_text(1, 100)]
        cells.append(", ".join(f"{100 * value:.0f}" for value in test["each"]))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def draw_curves(out: Path, rewards: Sequence[str], seeds: Sequence[int], *, window: int = 20) -> None:
    """Success of training episodes: running means, one line a run."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for index, reward in enumerate(rewards):
        for seed in seeds:
            rows = [row for row in read_metrics(run_of(out, reward, seed)) if "env/success" in row]
            points = [(row["step"], row["env/success"]) for row in rows]
            style = {"color": f"C{index}", "linewidth": 1, "label": reward if seed == seeds[0] else None}
            plot_running_mean(axes, points, window=window, **style)
    axes.set(xlabel="environment steps", ylabel=f"success, mean of {window} training episodes", ylim=(0, 1))
    axes.legend()
    figure.savefig(out / "curve.png", dpi=100)


def parse_arguments() -> argparse.Namespace:
    """Flags of the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/rewards"))
    parser.add_argument("--system", choices=sorted(SYSTEMS), default="dreamerv2")
    parser.add_argument("--preset", default="grid")
    parser.add_argument("--only", nargs="+", choices=list(REWARDS), default=list(REWARDS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--episodes", type=int, default=40, help="on each test floor")
    parser.add_argument("--train-episodes", type=int, default=10, help="on each training floor")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    return parser.parse_args()


def main() -> None:
    """Train and score what is not yet, write the table."""
    asked = parse_arguments()
    pairs = [(reward, seed) for seed in asked.seeds for reward in asked.only]
    with ProcessPoolExecutor(asked.workers, mp_context=get_context("spawn")) as pool:
        for name in pool.map(learn, [asked] * len(pairs), *zip(*pairs, strict=True)):
            print(f"{name} done", flush=True)
    found = {
        reward: {split: score(asked.out, reward, asked.seeds, split) for split in SPLITS}
        for reward in asked.only
    }
    atomic.write_text(asked.out / "rewards.json", json.dumps(found, default=vars, indent=1) + "\n")
    atomic.write_text(asked.out / "rewards.md", as_table(found))
    draw_curves(asked.out, asked.only, asked.seeds)
    print(as_table(found))


if __name__ == "__main__":
    main()
