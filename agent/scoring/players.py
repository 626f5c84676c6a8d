"""Who plays the fixed episodes, and the worker that does so, an episode a task."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import torch

from agent.config import EnvConfig, EpisodeRandomizeConfig
from agent.envs.episodes import EPISODES_VERSION, Episode
from agent.envs.pointnav import PointNavEnv
from agent.envs.sites import load_scene
from agent.rollout import Policy, run_episode
from agent.scoring.rows import Journal, checksum, make_row, task_of
from agent.systems.agent import CONFIG_FILE, WEIGHTS_FILE, Agent, find_agent
from agent.systems.controls import make_control
from langwm_data.config import CameraConfig, LabelsConfig, RenderConfig, ScenesConfig
from langwm_data.config_io import config_to_yaml
from langwm_data.scenes.spec import Split
from langwm_data.shards.writer import sha256_of
from langwm_data.workers import Report, Worker


@dataclass(frozen=True, kw_only=True)
class Player:
    """A system to be scored: a trained agent, a policy of the caller's, or a control."""

    system: str
    env: EnvConfig
    """What it sees and drives in."""
    out: Path
    """Folder of the evaluation that its rows belong to."""
    run: Path | None = None
    """Folder of a trained agent."""
    policy: Policy | None = None
    """The caller's own."""
    device: str = "cpu"
    identity: str
    """Checksum of all that its rows depend on beside the episode."""

    def load(self) -> Agent | None:
        """The trained agent, for ``enter`` on any number of floors; None where it is no such player."""
        return None if self.run is None else Agent.from_pretrained(self.run, self.device)

    def enter(self, env: gymnasium.Env, agent: Agent | None) -> tuple[gymnasium.Env, Policy]:
        """``env`` as it sees it, and its policy there; ``agent`` is what ``load`` gave."""
        if agent is not None:
            return agent.wrap_env(env), agent.act
        return env, self.policy or make_control(self.system, env)


@dataclass(frozen=True)
class Turn:
    """One task: who plays which episode."""

    player: int
    number: int
    """Of the episode on its floor."""
    episode: Episode

    def __str__(self) -> str:
        return f"episode {self.number} on {self.episode.scene}"


@dataclass(frozen=True, kw_only=True)
class PlayerWorker:
    """Makes the worker of a process that plays episodes; picklable unless a policy is not.

    PyTorch computes in one thread, so that results are the same for any number of workers. One floor is
    loaded at a time.
    """

    players: tuple[Player, ...]
    split: Split

    @contextlib.contextmanager
    def __call__(self) -> Iterator[Worker]:
        """The worker, as a pool wants it."""
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        stage = _Stage(self.players, self.split)
        try:
            yield stage.play
        finally:
            stage.close()
            torch.set_num_threads(threads)


class _Stage:
    """The environment and the policy that are loaded now."""

    def __init__(self, players: tuple[Player, ...], split: Split) -> None:
        self._players = players
        self._split: Split = split
        self._journals = {player.out: Journal(player.out) for player in players}
        self._loaded: tuple[int, str] | None = None
        self._agent: tuple[int, Agent | None] | None = None
        """Whose it is, and the agent of the player that was loaded last."""
        self._env: gymnasium.Env | None = None
        self._policy: Policy

    def play(self, turn: Turn, report: Report) -> None:
        """Play an episode and write down its row."""
        player = self._players[turn.player]
        env, policy = self._load(turn.player, turn.episode.scene)
        record = run_episode(env, policy, episode=turn.episode)
        row = make_row(
            record,
            system=player.system,
            split=self._split,
            episode=turn.number,
            task=task_of(turn.episode),
            player=player.identity,
        )
        self._journals[player.out].append(row)
        report(1)

    def _load(self, number: int, scene: str) -> tuple[gymnasium.Env, Policy]:
        player = self._players[number]
        if self._loaded != (number, scene) or self._env is None:
            self.close()
            world = PointNavEnv(player.env, self._split, scenes=[load_scene(scene, player.env)])
            if self._agent is None or self._agent[0] != number:
                self._agent = number, player.load()
            self._env, self._policy = player.enter(world, self._agent[1])
            self._loaded = number, scene
        return self._env, self._policy

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
            self._env = None


def trained_player(run: Path, env: EnvConfig, out: Path, device: str) -> Player:
    """The agent of a run.

    Raises:
        ValueError: If there is none.
    """
    agent = Agent.from_pretrained(run)
    files = [sha256_of(find_agent(run) / name) for name in (CONFIG_FILE, WEIGHTS_FILE)]
    identity = checksum(*files, device, world_of(env), config_to_yaml(_looks(env)))
    return Player(system=agent.system, env=env, out=out, run=run, device=device, identity=identity)


def control_player(name: str, env: EnvConfig, out: Path) -> Player:
    """A control; it looks at nothing, so nothing is rendered for it."""
    blind = replace(env, is_blind=True, with_labels=False)
    return Player(system=name, env=blind, out=out, identity=checksum(name, world_of(env)))


def world_of(env: EnvConfig) -> str:
    """All of an environment that a blind player's rows depend on, as text; scenes are in the episodes."""
    seen: dict[str, Any] = {
        "camera": CameraConfig(),
        "render": RenderConfig(),
        "labels": LabelsConfig(),
        "randomize": EpisodeRandomizeConfig(),
        "with_labels": False,
        "is_blind": False,
        "scenes": replace(env.scenes, baked=None),
        "seed_eval": 0,
    }
    return f"{EPISODES_VERSION}\n{config_to_yaml(replace(env, **seen))}"


def _looks(env: EnvConfig) -> EnvConfig:
    return replace(env, scenes=ScenesConfig(), with_labels=False)
