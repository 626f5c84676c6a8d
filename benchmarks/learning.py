"""Does a system learn? Each trains on a small known task (``benchmarks.known_tasks``), beside random actions.

Everything goes through ``train_agent``, as any environment does. Systems on the language-grounded autoencoder
see through one with random weights that stays as it is (``--mae RUN``: a pretrained one), but ``mwm``, which
needs neither depth nor labels to learn its own, and all on ``reach-grounded``, which gives both. Writes
``learning.md``, ``learning.json`` and ``curve.png`` into a folder of ``--out`` named after the task.

    python -m benchmarks.learning --system langwm --system curl --task reach --steps 3000 --out runs/learning
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from matplotlib.figure import Figure

import benchmarks.known_tasks  # noqa: F401  (registers the tasks)
from agent.config import AgentConfig
from agent.envs.make import make_env
from agent.rollout import Policy, run_episode
from agent.systems.agent import Agent
from agent.systems.controls import make_random_policy
from agent.systems.registry import SYSTEMS, load_agent_config
from agent.train import train_agent
from benchmarks.plots import plot_running_mean
from langwm_data.config_io import build_config, merge, parse_assignment
from langwm_data.seeding import derive_seed, make_rng
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, TextConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.metrics import read_metrics
from pretrain.statistics import bootstrap_interval

SIZE = 32
TASKS: dict[str, dict[str, Any]] = {
    "reach": {"id": "KnownTasks/Reach-v0"},
    "reach-pixels": {"id": "KnownTasks/Reach-v0", "kwargs": {"tells": False}},
    "reach-boxes": {"id": "KnownTasks/Reach-v0", "kwargs": {"tells": False, "labels": True}},
    "reach-grounded": {
        "id": "KnownTasks/Reach-v0",
        "kwargs": {"tells": False, "labels": True, "depth": True},
    },
    "line": {"id": "KnownTasks/Line-v0"},
    "line-blind": {"id": "KnownTasks/Line-v0", "kwargs": {"is_blind": True}},
    "pendulum": {"id": "KnownTasks/Pendulum-v0"},
    "pendulum-blind": {"id": "KnownTasks/Pendulum-v0", "kwargs": {"is_blind": True}},
}
"""What ``env`` is set to; in all but the first, frames alone, boxes, or nothing at all tells of the task."""
EVAL_SEED = 10_000
EPISODES = 30
SMALL = {"layers": 2, "units": 64}
MODEL: dict[str, Any] = {
    "height": SIZE,
    "width": SIZE,
    "conv_channels": [8, 16, 32],
    "dim": 32,
    "num_heads": 2,
    "encoder_layers": 1,
    "decoder_layers": 1,
}
SIZES: dict[str, Any] = {
    "finetune": {
        "model": MODEL,
        "text": {"model": "minilm"},
        "augment": {"padding_px": 2},
    },
    "world_model": {
        "pooling": {"dim": 32, "num_heads": 2, "num_layers": 1, "mlp_ratio": 2, "dropout": 0.0},
        "pixels": {"channels": 8},
        "rssm": {"num_latents": 8, "num_classes": 8, "deter": 64, "hidden": 64},
        "head": SMALL,
        "task": SMALL | {"scale": None, "skips_pooling": True},
        "loss_scales": {"reward": 100.0, "token": 0.1, "pool": 0.1, "image": 0.01, "kl": 0.1},
        "discount": 0.95,
        "learning_rate": 1e-3,
    },
    "behavior": {
        "imag_horizon": 8,
        "actor": SMALL,
        "critic": SMALL,
        "entropy_scale": 3e-2,
        "actor_learning_rate": 2e-4,
        "critic_learning_rate": 5e-4,
        "slow_critic_every": 25,
    },
    "batch_size": 8,
    "batch_length": 8,
    "sac": {"filters": 16, "hidden": 256, "batch_size": 64},
}
SCHEDULE = {"prefill_steps": 500, "update_every": 2, "log_every": 20, "checkpoint_every": 1000}


def write_untrained_mae(folder: Path) -> None:
    """An autoencoder with random weights for frames of this size."""
    torch.manual_seed(0)
    null = TextTokens(embed=torch.zeros(1, 3, 8), attend=torch.ones(1, 3, dtype=torch.bool))
    LanguageGroundedMAE(build_config(MAEConfig, MODEL), TextConfig(num_tokens=2), null).save_pretrained(
        folder
    )


def make_config(asked: argparse.Namespace, system: str) -> AgentConfig:
    """The configuration of one learner."""
    env = TASKS[asked.task] | {"camera": {"height": SIZE, "width": SIZE}}
    overrides = merge(SIZES, SCHEDULE | {"steps": asked.steps, "seed": asked.seed, "env": env})
    if system.startswith("langwm") and (asked.mae or not env.get("kwargs", {}).get("depth")):
        mae = asked.mae or asked.out / "untrained-mae"
        if asked.mae is None and not mae.exists():
            write_untrained_mae(mae)
        overrides = merge(overrides, {"features": "frozen", "mae": str(mae)})
    for text in asked.set:
        overrides = merge(overrides, parse_assignment(text))
    return load_agent_config(system, overrides=overrides)


def play(env: gymnasium.Env, act: Policy, system: str) -> dict[str, Any]:
    """Scores of a policy on episodes that are always the same; closes ``env``."""
    outcomes = [run_episode(env, act, seed=seed) for seed in range(EVAL_SEED, EVAL_SEED + EPISODES)]
    env.close()
    returns = np.array([outcome.total_reward for outcome in outcomes])
    known = [outcome.success for outcome in outcomes if outcome.success is not None]
    interval = bootstrap_interval(returns, make_rng(0, "learning", system))
    return {
        "system": system,
        "return": [interval.mean, interval.low, interval.high],
        "success": sum(known) / len(known) if known else None,
    }


def play_random(config: AgentConfig) -> dict[str, Any]:
    """Scores of random actions, drawn anew in every episode."""
    env = make_env(config.env)
    dim = env.action_space.shape[0]  # pyright: ignore[reportOptionalSubscript]
    count = iter(range(EPISODES))
    held: dict[str, Policy] = {}

    def act(obs: Any, state: Any) -> tuple[np.ndarray, Any]:
        if state is None:
            held["now"] = make_random_policy(derive_seed(0, "learning", next(count)), dim)
        return held["now"](obs, state)

    return play(env, act, "random")


def learn(asked: argparse.Namespace, system: str) -> dict[str, Any]:
    """Train, then score what was learned; a finished run is only scored."""
    config, out = make_config(asked, system), asked.out / asked.task / f"{system}-{asked.seed}"
    begin = time.process_time()
    train_agent(config, out)
    spent = time.process_time() - begin
    played = [row for row in read_metrics(out) if "env/return" in row]
    agent = Agent.from_pretrained(out)
    return {
        **play(agent.wrap_env(make_env(config.env)), agent.act, system),
        "cpu_s": spent,
        "updates": config.num_updates,
        "curve": [[row["step"], row["env/return"]] for row in played],
    }


def as_table(rows: list[dict[str, Any]]) -> str:
    """Markdown."""
    lines = ["| system | return [95 %] | success | updates | CPU s |", "|---|---|---|---|---|"]
    for row in rows:
        mean, low, high = row["return"]
        success = "" if row["success"] is None else f"{100 * row['success']:.0f} %"
        cost = f"{row['updates']:,} | {row['cpu_s']:.0f}" if "cpu_s" in row else "|"
        lines.append(f"| {row['system']} | {mean:.2f} [{low:.2f}, {high:.2f}] | {success} | {cost} |")
    return "\n".join(lines) + "\n"


def draw_curves(rows: list[dict[str, Any]], path: Path, *, window: int = 20) -> None:
    """Running means of the returns of training episodes."""
    figure = Figure(figsize=(6, 3.5), layout="constrained")
    axes = figure.subplots()
    for row in rows:
        if "curve" not in row:
            axes.axhline(row["return"][0], color="gray", linestyle=":", label=row["system"])
            continue
        plot_running_mean(axes, row["curve"], window=window, label=row["system"])
    axes.set(xlabel="environment steps", ylabel=f"return, mean of {window} episodes")
    axes.legend()
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--system", action="append", required=True, choices=sorted(SYSTEMS))
    parser.add_argument("--task", choices=sorted(TASKS), default="reach")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--mae", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/learning"))
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    rows = [play_random(make_config(asked, asked.system[0])), *(learn(asked, name) for name in asked.system)]
    folder = asked.out / asked.task
    (folder / "learning.json").write_text(json.dumps(rows) + "\n")
    (folder / "learning.md").write_text(as_table(rows))
    draw_curves(rows, folder / "curve.png")
    print(as_table(rows))


if __name__ == "__main__":
    main()
