"""Scores of an agent in an environment that is not PointGoal navigation, beside random actions.

Owns what is written under ``RUN/eval`` for such a run: ``episodes.parquet``, a row for each, and
``summary.json``.
Episode k is begun with the same seed whoever plays, so that differences are of the players.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agent.envs.make import make_env
from agent.evaluate import EVAL_FOLDER
from agent.rollout import Policy, run_episode
from agent.scoring.playing import SUMMARY_FILE
from agent.scoring.rows import EPISODES_FILE, Row
from agent.scoring.statistics import wilson_interval
from agent.systems.agent import Agent, find_agent, read_config
from agent.systems.controls import make_random_policy
from langwm_data import atomic
from langwm_data.config_io import ConfigError
from langwm_data.seeding import derive_seed, make_rng
from pretrain.statistics import Interval, bootstrap_interval
from pretrain.train import usable_device

Progress = Callable[[int, int], None]
RANDOM = "random"
_FIRST_SEED = 2**30
"""Far from those of training."""


@dataclass(frozen=True, kw_only=True)
class PlainScore:
    """How one player did, with 95 % intervals."""

    system: str
    num_episodes: int
    total_reward: Interval
    length: Interval
    success: Interval | None
    """None where the environment does not say."""


@dataclass(frozen=True, kw_only=True)
class PlainSummary:
    """Of all players."""

    scores: tuple[PlainScore, ...]

    def as_text(self) -> str:
        """A line for each player."""
        lines = [f"{'system':28} {'episodes':>8}  {'return':28} {'length':>8}  success %"]
        for score in self.scores:
            success = "not known" if score.success is None else f"{100 * score.success.mean:.1f}"
            total = score.total_reward.as_text(2)
            lines.append(
                f"{score.system:28} {score.num_episodes:8}  {total:28} {score.length.mean:8.1f}  {success}"
            )
        return "\n".join(lines)


def is_elsewhere(run: Path) -> bool:
    """Whether a run learned in another environment than PointGoal navigation.

    Raises:
        ValueError: If it holds no trained agent.
    """
    return read_config(find_agent(run))[0].env.id is not None


def evaluate_anywhere(
    run: Path | str,
    *,
    env: gymnasium.Env | None = None,
    episodes: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
) -> PlainSummary:
    """Play episodes in the environment that the agent learned in, and write ``RUN/eval``.

    Args:
        run: Folder of a ``train-agent`` run.
        env: Play here instead; it is closed at the end.
        episodes: How many each plays; as the run's config says when None.
        device: Where the agent computes.
        progress: Called with episodes done and in all.

    Raises:
        ConfigError: If the device cannot be used, the environment cannot be made, or making it would import a
            module that the run names.
        ValueError: If there is no trained agent.
    """
    usable_device(device)
    agent = Agent.from_pretrained(run, device)
    if env is None and ":" in (agent.env.id or ""):
        raise ConfigError(
            f"{run} names env.id {agent.env.id!r}, and what a run names is not imported; give the"
            " environment: evaluate_anywhere(run, env=gymnasium.make(...))"
        )
    count = agent.config.eval_episodes if episodes is None else episodes
    world = agent.wrap_env(make_env(agent.env, env))
    rows: list[Row] = []
    try:
        for system in (agent.system, RANDOM):
            for number in range(count):
                wander = make_random_policy(derive_seed(0, RANDOM, number), agent.spaces.action_dim)
                rows.append(_play(world, agent.act if system == agent.system else wander, system, number))
                if progress is not None:
                    progress(len(rows), 2 * count)
    finally:
        world.close()
    summary = PlainSummary(scores=tuple(_score(name, rows) for name in (agent.system, RANDOM)))
    _write(Path(run) / EVAL_FOLDER, rows, summary)
    return summary


def _play(env: gymnasium.Env, policy: Policy, system: str, number: int) -> Row:
    outcome = run_episode(env, policy, seed=_FIRST_SEED + number)
    return {
        "system": system,
        "episode": number,
        "return": outcome.total_reward,
        "length": outcome.num_steps,
        "success": outcome.success,
        "is_terminated": outcome.is_terminated,
    }


def _score(system: str, rows: Sequence[Row]) -> PlainScore:
    own = [row for row in rows if row["system"] == system]
    known = [row["success"] for row in own if row["success"] is not None]
    means = {
        name: bootstrap_interval(np.array([row[name] for row in own], np.float64), make_rng(0, system, name))
        for name in ("return", "length")
    }
    return PlainScore(
        system=system,
        num_episodes=len(own),
        total_reward=means["return"],
        length=means["length"],
        success=wilson_interval(sum(known), len(known)) if known else None,
    )


def _write(out: Path, rows: Sequence[Row], summary: PlainSummary) -> None:
    fields = [
        ("system", pa.string()),
        ("episode", pa.int64()),
        ("return", pa.float64()),
        ("length", pa.int64()),
    ]
    schema = pa.schema([*fields, ("success", pa.bool_()), ("is_terminated", pa.bool_())])
    with atomic.atomic_path(out / EPISODES_FILE) as temporary:
        pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), temporary)
    atomic.write_json(out / SUMMARY_FILE, {"scores": [asdict(score) for score in summary.scores]})
