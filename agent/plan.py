"""What a training run will take, from a short trial of it that is thrown away."""

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import gymnasium
from gymnasium.wrappers import TimeLimit

from agent.config import AgentConfig
from agent.replay import Replay, step_bytes
from agent.rollout import Collector
from agent.systems.agent import Agent
from agent.systems.controls import make_random_policy
from agent.systems.features import Encoder
from agent.systems.registry import find_system
from agent.systems.system import Learner, Spaces, System
from langwm_data.seeding import derive_seed
from langwm_data.shards.summary import format_size
from pretrain.train import usable_device

_STEPS = 50
_UPDATES = 2
"""After one that warms up."""


@dataclass(frozen=True, kw_only=True)
class TrainingEstimate:
    """What a run will take on this machine, as busy as it is now."""

    steps: int
    updates: int
    pretrain_updates: int
    """Before the ordinary ones."""
    held_steps: int
    """Steps in the replay buffer when it is fullest, with what the next checkpoint deletes."""
    bytes_per_step: int
    seconds_per_step: float
    """To act and to step, without learning."""
    seconds_per_update: float
    seconds_per_pretrain_update: float
    memory_bytes: int
    """Of the trial at its largest."""

    @property
    def hours(self) -> float:
        """Until the last step."""
        learning_s = self.updates * self.seconds_per_update
        learning_s += self.pretrain_updates * self.seconds_per_pretrain_update
        return (self.steps * self.seconds_per_step + learning_s) / 3600

    def as_text(self) -> str:
        """One line each for steps, updates, disk, memory and time."""
        first = f" after {self.pretrain_updates:,} of what perceives alone" if self.pretrain_updates else ""
        return "\n".join(
            (
                f"steps   {self.steps:,} of the environment, {1e3 * self.seconds_per_step:.3g} ms each",
                f"updates {self.updates:,}, {self.seconds_per_update:.3g} s each{first}",
                f"disk    {format_size(self.held_steps * self.bytes_per_step)} of replay:"
                f" {self.held_steps:,} steps of {self.bytes_per_step:,} bytes at most",
                f"memory  {format_size(self.memory_bytes)}",
                f"time    {self.hours:.2g} h, without evaluation",
                f"measured on {_STEPS} steps and {_UPDATES} updates, which are thrown away",
            )
        )


def plan_training(
    config: AgentConfig, *, env: gymnasium.Env | None = None, encoder: Encoder | None = None
) -> TrainingEstimate:
    """Take a few steps and updates in a temporary folder and say what the whole run will take.

    Args:
        config: Of the run.
        env: As ``train_agent`` takes it; it is closed.
        encoder: As ``train_agent`` takes it.

    Raises:
        ConfigError: If the run cannot be carried out.
    """
    usable_device(config.device)
    system = find_system(config.system, encoder)
    env = system.make_env(config, env)
    try:
        spaces = Spaces.of(env)
        agent = Agent(system.create(config, spaces), config, spaces)
        with tempfile.TemporaryDirectory(prefix="langwm-plan-") as folder:
            replay = Replay(config.replay, Path(folder))
            step_s = _collect(config, system, env, agent, replay)
            learner = system.make_learner(agent.model, config)
            pretrain_s = _time_pretraining(learner, replay)
            update_s = _time(lambda index: learner.update(replay, index))
    finally:
        env.close()
    return TrainingEstimate(
        steps=config.steps,
        updates=config.num_updates,
        pretrain_updates=config.finetune.pretrain_updates if pretrain_s else 0,
        held_steps=min(config.steps, config.replay.capacity_steps + config.checkpoint_every),
        bytes_per_step=bytes_a_step(config, system, spaces),
        seconds_per_step=step_s,
        seconds_per_update=update_s,
        seconds_per_pretrain_update=pretrain_s,
        memory_bytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        * (1 if sys.platform == "darwin" else 1024),
    )


def bytes_a_step(config: AgentConfig, system: System, spaces: Spaces) -> int:
    """What one step takes in the replay buffer."""
    return step_bytes(
        spaces.height,
        spaces.width,
        spaces.task_dim + spaces.action_dim,
        with_depth=system.needs_depth(config),
        with_objects=system.needs_labels(config),
        features=spaces.feature_dim,
    )


def _collect(config: AgentConfig, system: System, env: gymnasium.Env, agent: Agent, replay: Replay) -> float:
    """Fill the buffer by random actions; seconds of one step, acting by the agent included."""
    collector = Collector(
        TimeLimit(env, _STEPS),
        seed=0,
        with_depth=system.needs_depth(config),
        with_objects=system.needs_labels(config),
    )
    wander = make_random_policy(derive_seed(config.seed, "plan"), agent.spaces.action_dim)
    start = time.perf_counter()
    for _ in range(_STEPS):
        if (done := collector.step(wander)) is not None:
            replay.add(done.replay)
    step_s = (time.perf_counter() - start) / _STEPS
    obs, _ = env.reset(seed=0)
    return step_s + _time(lambda _: agent.act(obs, explore=True))


def _time_pretraining(learner: Learner, replay: Replay) -> float:
    return 0.0 if learner.is_pretrained else _time(lambda _: learner.pretrain(replay))


def _time(do: Callable[[int], object]) -> float:
    """Seconds of one call, after one that warms up."""
    do(0)
    start = time.perf_counter()
    for index in range(1, 1 + _UPDATES):
        do(index)
    return (time.perf_counter() - start) / _UPDATES
