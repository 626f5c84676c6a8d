"""Scores on fixed episodes: one function for agents and controls, a row per episode.

Owns what is written under ``RUN/eval``. Every table is rebuilt from ``episodes.parquet``.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from agent.config import AgentConfig, EnvConfig
from agent.envs.episodes import EPISODES_VERSION, Episode, fixed_episodes
from agent.envs.pointnav import PointNavEnv
from agent.rollout import EpisodeRecord, Policy, run_episode
from agent.statistics import wilson_interval
from agent.systems.agent import Agent
from agent.systems.controls import CONTROLS
from langwm_data import atomic
from langwm_data.config_io import CONFIG_FILE, ConfigError, load_config_file
from langwm_data.scenes.spec import Split
from langwm_data.seeding import make_rng
from pretrain.statistics import Interval, bootstrap_interval

EVAL_FOLDER = "eval"
EPISODES_FILE = "episodes.parquet"
SUMMARY_FILE = "summary.json"
AGENT = "langwm"
"""Name of the trained agent in tables."""
MEANS = ("spl", "soft_spl", "distance_to_goal", "path_length", "collisions", "length", "return")
"""Columns whose mean is reported with a bootstrap interval; success has Wilson's."""

Row = dict[str, Any]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Score:
    """How one system did in one group of episodes."""

    system: str
    split: str
    tier: int | None
    """None: all distances together."""
    num_episodes: int
    success: Interval
    means: Mapping[str, Interval]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, every measure beside the others."""
        head = {"system": self.system, "split": self.split, "tier": self.tier, "episodes": self.num_episodes}
        measures = {"success": self.success, **self.means}
        return head | {name: asdict(interval) for name, interval in measures.items()}


@dataclass(frozen=True)
class Summary:
    """Scores of all systems."""

    scores: tuple[Score, ...]

    def as_text(self) -> str:
        """A table for a terminal; intervals at 95 %."""
        lines = [
            f"{'system':<16}{'floors':<8}{'n':>5}  {'success %':<20}{'SPL':<20}{'SoftSPL':<20}to goal, m"
        ]
        for score in self.scores:
            if score.tier is None:
                cells = [_as_text(score.success, 100.0, 1)]
                cells += [_as_text(score.means[k], 1.0, 2) for k in ("spl", "soft_spl", "distance_to_goal")]
                head = f"{score.system:<16}{score.split:<8}{score.num_episodes:>5}  "
                lines.append(head + "".join(f"{cell:<20}" for cell in cells).rstrip())
        return "\n".join(lines)


def evaluate_run(
    run: Path | str,
    *,
    split: str = "test",
    episodes_per_scene: int | None = None,
    progress: Progress | None = None,
) -> Summary:
    """Score the agent of a training run beside the controls and write ``RUN/eval``.

    Rows of the other split that are already there stay.

    Args:
        run: Folder of a ``train-agent`` run.
        split: ``train`` or ``test`` floors.
        episodes_per_scene: As the run's config says when None.
        progress: Called with episodes done and in all.

    Raises:
        ConfigError: If ``split`` is unknown.
        ValueError: If there is no trained agent.
    """
    run = Path(run)
    agent = Agent.from_pretrained(run)
    config = load_config_file(AgentConfig, run / CONFIG_FILE)
    return evaluate_agent(
        agent.act,
        env=config.env,
        split=split,
        episodes_per_scene=episodes_per_scene or config.eval_episodes,
        out=run / EVAL_FOLDER,
        progress=progress,
    )


def evaluate_agent(
    agent: Policy | Path | str,
    *,
    env: EnvConfig | None = None,
    split: str = "test",
    episodes_per_scene: int = 500,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Summary:
    """Score an agent beside the controls on the fixed episodes of a split.

    Args:
        agent: A policy, or the folder of a trained agent.
        env: What the episodes are drawn from; the trained agent's own environment when None.
        split: ``train`` or ``test`` floors.
        episodes_per_scene: The same episodes for every system, and the first ones of a longer list.
        out: Write ``episodes.parquet`` and ``summary.json`` here.
        progress: Called with episodes done and in all.

    Raises:
        ConfigError: If ``split`` is unknown.
        ValueError: If the folder holds no trained agent.
    """
    if isinstance(agent, Path | str):
        trained = Agent.from_pretrained(agent)
        agent, env = trained.act, env or trained.env
    config, known = env or EnvConfig(), _as_split(split)
    episodes = fixed_episodes(config, known, episodes_per_scene)
    rows, total = [], (1 + len(CONTROLS)) * len(episodes)

    def tick(done: int) -> None:
        if progress is not None:
            progress(len(rows) + done, total)

    with contextlib.closing(PointNavEnv(config, known)) as world:
        rows += play(AGENT, agent, world, episodes, split=split, tick=tick)
    # The controls look at nothing, so nothing is rendered for them.
    with contextlib.closing(PointNavEnv(replace(config, is_blind=True), known)) as world:
        for name, control in CONTROLS.items():
            rows += play(name, control, world, episodes, split=split, tick=tick)
    if out is not None:
        rows += [row for row in read_rows(out) if row["split"] != split]
        write_rows(out, rows)
    return summarise(rows)


def play(
    system: str,
    policy: Policy,
    env: gymnasium.Env,
    episodes: Sequence[Episode],
    *,
    split: str,
    tick: Callable[[int], None] | None = None,
) -> list[Row]:
    """Play every episode once; ``tick`` is called with how many are done."""
    rows = []
    for number, episode in enumerate(episodes):
        record = run_episode(env, policy, episode=episode)
        rows.append({"system": system, "split": split, "episode": number, **_as_row(record)})
        if tick is not None:
            tick(len(rows))
    return rows


def summarise(rows: Sequence[Row]) -> Summary:
    """Scores per system and split, over all distances and per tier."""
    groups: dict[tuple[str, str, int | None], list[Row]] = {}
    for row in rows:
        for tier in (None, row["tier"]):
            groups.setdefault((row["system"], row["split"], tier), []).append(row)
    in_order = sorted(groups, key=lambda g: (g[1], g[2] is not None, g[2] or 0))
    return Summary(tuple(_score(*group, groups[group]) for group in in_order))


def write_rows(out: Path, rows: Sequence[Row]) -> None:
    """Write ``episodes.parquet`` and, rebuilt from it, ``summary.json``."""
    table = pa.Table.from_pylist(list(rows))
    with atomic.atomic_path(out / EPISODES_FILE) as temporary:
        pq.write_table(table, temporary)
    scores = [score.to_dict() for score in summarise(rows).scores]
    atomic.write_json(out / SUMMARY_FILE, {"episodes_version": EPISODES_VERSION, "scores": scores})


def read_rows(out: Path) -> list[Row]:
    """The rows of ``episodes.parquet``; none where there is no such file."""
    path = out / EPISODES_FILE
    return pq.read_table(path).to_pylist() if path.is_file() else []


def _score(system: str, split: str, tier: int | None, rows: Sequence[Row]) -> Score:
    rng = make_rng(0, "bootstrap", system, split, -1 if tier is None else tier)
    columns = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in MEANS}
    return Score(
        system=system,
        split=split,
        tier=tier,
        num_episodes=len(rows),
        success=wilson_interval(sum(row["success"] for row in rows), len(rows)),
        means={name: bootstrap_interval(values, rng) for name, values in columns.items()},
    )


def _as_row(record: EpisodeRecord) -> Row:
    row = asdict(record) | {"trajectory": record.trajectory.tolist(), "goal": record.goal.tolist()}
    row["length"] = row.pop("num_steps")
    row["return"] = row.pop("total_reward")
    return row


def _as_split(split: str) -> Split:
    if split == "train" or split == "test":
        return split
    raise ConfigError(f"--split {split!r} is unknown; allowed: train, test")


def _as_text(interval: Interval, scale: float, digits: int) -> str:
    mean, low, high = (scale * x for x in (interval.mean, interval.low, interval.high))
    return f"{mean:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
