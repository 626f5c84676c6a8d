"""Scores on fixed episodes: one function for agents and controls, a row per episode.

Owns what is written under ``RUN/eval``: ``episodes.parquet``, from which every table is rebuilt,
``episodes-<split>.json``, the episodes as they can be handed on, and ``summary.json``.
"""

import secrets
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from agent.config import AgentConfig, EnvConfig
from agent.envs.episode_file import (
    EpisodeSet,
    check_fits,
    make_episode_set,
    read_episode_file,
    write_episode_file,
)
from agent.rollout import Policy
from agent.scoring.players import Player, control_player, trained_player, world_of
from agent.scoring.playing import SUMMARY_FILE, Progress, keep_rows, play, play_all, write_rows
from agent.scoring.rows import EPISODES_FILE, Row, claimed, read_rows
from agent.scoring.summary import MEANS, Score, Summary, compare, pool_runs, summarise
from agent.systems.agent import Agent, find_agent, read_config
from agent.systems.controls import CONTROL_NAMES
from langwm_data.config_io import CONFIG_FILE, ConfigError, load_config_file
from langwm_data.scenes.spec import Split
from pretrain.train import usable_device

__all__ = [
    "EPISODES_FILE",
    "MEANS",
    "SUMMARY_FILE",
    "Plan",
    "Row",
    "Score",
    "Summary",
    "evaluate_agent",
    "evaluate_run",
    "evaluate_runs",
    "play",
    "read_rows",
    "summarise",
    "write_rows",
]

EVAL_FOLDER = "eval"
CALLER = "agent"
"""Name of a policy of the caller's in tables."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is to be played, and how."""

    split: str = "test"
    """``train`` or ``test`` floors."""
    episodes_per_scene: int | None = None
    """None: all of ``episodes_file``, or as many as the first run's config says."""
    episodes_file: Path | None = None
    """Play these in place of those that the config describes."""
    controls: tuple[str, ...] = CONTROL_NAMES
    """Played beside the agents."""
    workers: int = 1
    """Processes; more need a script guarded by ``if __name__ == "__main__":``."""
    videos: int = 0
    """Episodes of each agent that are filmed, with a map of every floor."""
    device: str = "cpu"
    """Where agents compute."""
    data: Path | None = None
    """Dataset to read baked scenes from in place of the one that the runs name."""

    def __post_init__(self) -> None:
        """Refuse what cannot be done."""
        if self.split not in ("train", "test"):
            raise ConfigError(f"--split {self.split!r} is unknown; allowed: train, test")
        if self.workers < 1 or self.videos < 0 or (self.episodes_per_scene or 1) < 1:
            raise ConfigError(
                f"--workers {self.workers}, --video {self.videos}, --episodes {self.episodes_per_scene}:"
                " allowed: 1 or more workers and episodes, 0 or more videos"
            )
        if unknown := set(self.controls) - set(CONTROL_NAMES):
            raise ConfigError(
                f"control {sorted(unknown)[0]!r} is unknown; allowed: {', '.join(CONTROL_NAMES)}"
            )

    @property
    def floors(self) -> Split:
        """``split``, which was checked."""
        return "train" if self.split == "train" else "test"


def evaluate_run(
    run: Path | str,
    *,
    split: str = "test",
    episodes_per_scene: int | None = None,
    workers: int = 1,
    controls: Sequence[str] = CONTROL_NAMES,
    progress: Progress | None = None,
) -> Summary:
    """Score the agent of a training run beside controls and write ``RUN/eval``.

    Rows of the other split that are already there stay, and episodes that are already there are not played
    again, unless the agent has learned since.

    Args:
        run: Folder of a ``train-agent`` run.
        split: ``train`` or ``test`` floors.
        episodes_per_scene: As the run's config says when None.
        workers: Processes.
        controls: Who plays beside it.
        progress: Called with episodes done and in all.

    Raises:
        ConfigError: If ``split`` or a control is unknown.
        ValueError: If there is no trained agent.
    """
    plan = Plan(split=split, episodes_per_scene=episodes_per_scene, workers=workers, controls=tuple(controls))
    return evaluate_runs([Path(run)], plan, progress=progress)


def evaluate_runs(runs: Sequence[Path], plan: Plan, *, progress: Progress | None = None) -> Summary:
    """Score agents of several runs on the same episodes, beside controls that play once for all.

    Args:
        runs: Folders of ``train-agent`` runs, whose worlds must be alike. Each gets its own ``eval`` folder.
        plan: What is to be played.
        progress: Called with episodes done and in all.

    Returns:
        Scores of all, and how the first run differs from each other one and from the controls.

    Raises:
        ConfigError: If the runs are not of one world, one is named twice, or the device cannot be used.
        ValueError: If there is no trained agent, or the episodes are of something else.
    """
    usable_device(plan.device)
    if len({run.resolve() for run in runs}) < max(1, len(runs)):
        raise ConfigError(f"runs {', '.join(map(str, runs))} must be one or more, none of them twice")
    configs = [_config_of(run) for run in runs]
    for run, config in zip(runs, configs, strict=True):
        if config.env.id is not None:
            raise ConfigError(
                f"{run} learned in env {config.env.id!r}, which has no fixed episodes; score it alone,"
                " without --split, --episodes-file, --workers, --video and --data"
            )
    envs = [_at(config.env, plan.data) for config in configs]
    for run, env in zip(runs, envs, strict=True):
        if world_of(env) != world_of(envs[0]):
            raise ConfigError(
                f"{runs[0]} and {run} drive in different worlds (see env in their {CONFIG_FILE});"
                " score them apart"
            )
    count = plan.episodes_per_scene
    if count is None and plan.episodes_file is None:
        count = configs[0].eval_episodes
    agents = [
        trained_player(run, env, run / EVAL_FOLDER, plan.device) for run, env in zip(runs, envs, strict=True)
    ]
    episodes = _episodes(envs[0], replace(plan, episodes_per_scene=count))
    labels = _labels([agent.system for agent in agents], runs)
    return _evaluate(agents, labels, episodes, plan, progress)


def evaluate_agent(
    agent: Policy | Path | str,
    *,
    env: EnvConfig | None = None,
    split: str = "test",
    episodes_per_scene: int = 500,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Summary:
    """Score an agent beside the controls on the fixed episodes of a split, in this process.

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
    plan = Plan(split=split, episodes_per_scene=episodes_per_scene)
    with ExitStack() as held:
        folder = out or Path(held.enter_context(tempfile.TemporaryDirectory()))
        if isinstance(agent, Path | str):
            world = env or Agent.from_pretrained(agent).env
            player = trained_player(Path(agent), world, folder, plan.device)
        else:
            world = env or EnvConfig()
            # Nobody knows what the caller's policy depends on, so it is always played.
            identity = secrets.token_hex(8)
            player = Player(system=CALLER, env=world, out=folder, policy=agent, identity=identity)
        return _evaluate([player], [player.system], _episodes(world, plan), plan, progress)


def _evaluate(
    agents: Sequence[Player],
    labels: Sequence[str],
    episodes: EpisodeSet,
    plan: Plan,
    progress: Progress | None,
) -> Summary:
    """Play what is not played yet, write it down, and sum up what was asked for."""
    controls = [control_player(name, agents[0].env, agents[0].out) for name in plan.controls]
    players = (*agents, *controls)
    with ExitStack() as held:
        for agent in agents:
            held.enter_context(claimed(agent.out))
            write_episode_file(agent.out / f"episodes-{plan.split}.json", episodes)
        rows = play_all(players, episodes, plan.workers, progress)
        for agent in agents:
            own = [agent, *controls]
            keep_rows(agent.out, own, [row for p in own for row in rows[p]], episodes)
        if plan.videos:
            from agent.scoring.footage import film, write_maps  # matplotlib, which nothing else here needs

            for agent in agents:
                film(agent, episodes, plan.videos)
                write_maps(agent, episodes, rows[agent])
    named = [
        row | {"system": label}
        for player, label in zip(players, [*labels, *plan.controls], strict=True)
        for row in rows[player]
    ]
    scores = summarise(named).scores
    systems = {label: agent.system for label, agent in zip(labels, agents, strict=True)}
    others = [*labels[1:], *plan.controls]
    differences = [d for other in others for d in compare(named, labels[0], other)]
    return Summary((*scores, *pool_runs(named, systems)), tuple(differences))


def _episodes(env: EnvConfig, plan: Plan) -> EpisodeSet:
    if plan.episodes_file is None:
        assert plan.episodes_per_scene is not None
        return make_episode_set(env, plan.floors, plan.episodes_per_scene)
    episodes = read_episode_file(plan.episodes_file)
    check_fits(episodes, env, plan.floors, plan.episodes_file)
    return episodes if plan.episodes_per_scene is None else episodes.first(plan.episodes_per_scene)


def _config_of(run: Path) -> AgentConfig:
    """What a run was trained with, and where its baked scenes lie if it still has its own config file."""
    config, _ = read_config(find_agent(run))  # refuses what is no agent
    path = run / CONFIG_FILE
    return load_config_file(AgentConfig, path) if path.is_file() else config


def _at(env: EnvConfig, data: Path | None) -> EnvConfig:
    """``env`` with its baked scenes in another dataset, if one is given."""
    return env if data is None else replace(env, scenes=replace(env.scenes, baked=str(data)))


def _labels(systems: Sequence[str], runs: Sequence[Path]) -> list[str]:
    """Names in a table of several runs: systems, with the run where that is not enough."""
    return [
        system if list(systems).count(system) == 1 else f"{system} {run}"
        for system, run in zip(systems, runs, strict=True)
    ]
