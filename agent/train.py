"""The training loop of stage three: collect, update, log, save.

Owns the order of events and what a checkpoint holds. Every random number is derived from the seed and
a counter, so a run that was killed at any moment goes on from its last checkpoint with the same numbers.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from agent.best import BEST_FOLDER, Best
from agent.config import AgentConfig
from agent.evaluate import EVAL_FOLDER
from agent.models.world_model import Metrics
from agent.plan import bytes_a_step
from agent.replay import Replay, check_disk
from agent.rollout import Collector
from agent.systems.agent import Agent
from agent.systems.controls import make_random_policy
from agent.systems.features import Encoder
from agent.systems.registry import find_system
from agent.systems.system import Spaces, State, System
from langwm_data.claim import Kind, check_output, claim_output
from langwm_data.seeding import derive_seed
from pretrain.checkpoint import CHECKPOINTS, latest_checkpoint, load_checkpoint, save_checkpoint
from pretrain.interrupt import stop_requests
from pretrain.metrics import METRICS_FILE, TENSORBOARD, MetricsLogger
from pretrain.model_file import MODEL_FOLDER
from pretrain.train import usable_device
from pretrain.update import torch_seed

log = logging.getLogger(__name__)

REPLAY_FOLDER = "replay"
_KIND = Kind(
    writes=(METRICS_FILE, TENSORBOARD, CHECKPOINTS, MODEL_FOLDER, BEST_FOLDER, REPLAY_FOLDER, EVAL_FOLDER),
    may_differ=("steps", "eval_episodes"),
)
PRETRAINING_CHECKPOINT_EVERY = 500
"""Updates; an autoencoder's first thousands may take hours in which no step is taken."""
Progress = Callable[[int, int], None]


def train_agent(
    config: AgentConfig,
    out: Path,
    *,
    fresh: bool = False,
    progress: Progress | None = None,
    env: gymnasium.Env | None = None,
    encoder: Encoder | None = None,
) -> Path:
    """Train an agent, going on where an earlier call stopped.

    Args:
        config: Everything about the run.
        out: Folder of the run.
        fresh: Throw away what ``out`` holds first.
        progress: Called with environment steps done and in all.
        env: Learn in this environment instead of the one that ``config.env`` names. It must be deterministic
            and have frames and bounded actions; see ``ForeignEnv``. It is closed at the end.
        encoder: What system ``own-encoder`` sees through: one method, ``encode``, from frames (B, H, W, 3)
            uint8 to tokens (B, N, D). It is never trained or saved.

    Returns:
        ``out``; ``Agent.from_pretrained`` reads it, and ``out / "best"`` (see ``agent.best``).

    Raises:
        ConfigError: If the request cannot be carried out; nothing was changed then.
        KeyboardInterrupt: After SIGINT or SIGTERM, once everything is saved.
        FloatingPointError: If training diverges.
        OSError: If something cannot be written, for instance because the disk is full; the same call goes on
            from the last checkpoint.
    """
    usable_device(config.device)
    system = find_system(config.system, encoder)
    reads = (config.mae, config.finetune.text.model, *config.env.scenes.folders)
    check_output(out, config, _KIND, fresh=fresh, reads=reads)
    taken = 0 if fresh else _steps_taken(out)
    config = replace(config, steps=max(config.steps, taken))  # what is done stays done
    env = system.make_env(config, env)
    try:
        spaces = Spaces.of(env)
        model = system.create(config, spaces)
        _check_disk(config, system, spaces, out)
        start = None if taken == config.steps else _start(config, out, env, system, fresh=fresh)
        claim_output(out, config, _KIND, fresh=fresh, reads=reads)
        if start is None:
            log.info("%s has taken %d steps already; --fresh starts over", out, taken)
            return out
        agent = Agent(model, system.resolve(config, model), spaces)
        run = _Run(config, out, agent, system, start)
        del start  # it holds the weights a second time
        with MetricsLogger(out, run.step) as logger, stop_requests() as stop:
            while run.step < config.steps and not stop.is_set():
                run.advance(logger)
                if run.is_checkpoint_due:
                    run.save()
                if progress is not None:
                    progress(run.step, config.steps)
            if not run.is_saved:
                run.save()
            if not run.has_learned and not stop.is_set():
                log.warning(
                    "%s has learned nothing: %d steps are over before the first update, with prefill_steps"
                    " %d; the same command with more steps goes on",
                    out,
                    config.steps,
                    config.prefill_steps,
                )
    finally:
        env.close()
    if stop.is_set():
        raise KeyboardInterrupt
    return out


def _steps_taken(out: Path) -> int:
    """By the last checkpoint of the run in ``out``."""
    folder = latest_checkpoint(out)
    return 0 if folder is None else int(folder.name.removeprefix("step-"))


def _check_disk(config: AgentConfig, system: System, spaces: Spaces, out: Path) -> None:
    size = bytes_a_step(config, system, spaces)
    # Episodes that left since the last checkpoint still have their files.
    steps = min(config.steps, config.replay.capacity_steps + config.checkpoint_every)
    folder = out / REPLAY_FOLDER
    check_disk(folder, steps=steps, bytes_a_step=size)
    log.info("replay: up to %d steps of %d bytes, %.1f GB in %s", steps, size, steps * size / 1e9, folder)


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Where a run begins or goes on."""

    step: int
    state: dict[str, Any]
    """Of the last checkpoint; empty where there is none."""
    collector: Collector


def _start(config: AgentConfig, out: Path, env: gymnasium.Env, system: System, *, fresh: bool) -> _Start:
    """Read the last checkpoint and begin the episode that is next: only then may an environment refuse."""
    folder = None if fresh else latest_checkpoint(out)
    step, state = (0, {}) if folder is None else load_checkpoint(folder, config.device)
    collector = Collector(
        env,
        seed=derive_seed(config.seed, "episodes") % 2**31,
        state=state.get("collector"),
        with_depth=system.needs_depth(config),
        with_objects=system.needs_labels(config),
    )
    collector.policy_state = state.get("policy_state")
    return _Start(step=step, state=state, collector=collector)


class _Run:
    """Everything that learns, collects and remembers in one run."""

    def __init__(self, config: AgentConfig, out: Path, agent: Agent, system: System, start: _Start) -> None:
        self._config = config
        self._out = out
        self.step = start.step
        self._collector = start.collector
        self._has_collected = True
        """Whether the last thing done was a step and not an update before the ordinary ones."""
        self._since_saved = 0
        """Steps and updates before the ordinary ones that no checkpoint has."""
        state = start.state
        self._num_updates: int = state.get("num_updates", 0)
        self._means = _Means(state.get("means"))
        self._agent = agent
        self._learner = system.make_learner(agent.model, config)
        if state:
            agent.model.load_state_dict(state["model"])
            self._learner.load_state_dict(state["learner"])
        self._best = Best(out, state.get("best"))
        self._replay = Replay(config.replay, out / REPLAY_FOLDER, state.get("replay"))

    @property
    def is_pretraining(self) -> bool:
        """Whether something still has to learn from the prefilled replay before the ordinary updates."""
        is_due = self.step >= self._config.prefill_steps and self._replay.num_episodes > 0
        return is_due and not self._learner.is_pretrained

    @property
    def has_learned(self) -> bool:
        """Whether any ordinary update was taken."""
        return self._num_updates > 0

    @property
    def is_saved(self) -> bool:
        """Whether the last checkpoint has everything."""
        return self._since_saved == 0

    @property
    def is_checkpoint_due(self) -> bool:
        """After so many steps; where something is pretrained, before, after so many updates, and after."""
        if self.is_pretraining:
            return self._has_collected or self._since_saved >= PRETRAINING_CHECKPOINT_EVERY
        return not self._has_collected or self.step % self._config.checkpoint_every == 0

    def advance(self, logger: MetricsLogger) -> None:
        """Do the next thing: an update before the ordinary ones, or a step and, where due, an update."""
        config = self._config
        self._since_saved += 1
        self._has_collected = not self.is_pretraining
        if self.is_pretraining:
            self._means.add(self._learner.pretrain(self._replay))
            if not self.is_pretraining:
                logger.log(self.step, self._means.take())
            return
        start = time.perf_counter()
        self._collect(logger)
        self._means.add({"time/env_step_s": time.perf_counter() - start})
        is_due = self.step >= config.prefill_steps and self.step % config.update_every == 0
        if is_due and self._replay.num_episodes > 0 and not self.is_pretraining:
            start = time.perf_counter()
            metrics = self._learner.update(self._replay, self._num_updates)
            self._num_updates += 1
            self._means.add(metrics | {"time/update_s": time.perf_counter() - start})
            if self._num_updates % config.log_every == 0:
                logger.log(self.step, self._means.take())

    def save(self) -> None:
        """Write the models and, last, the checkpoint."""
        # An interrupt saves as well, but must not change which agent the run ends up with as its best.
        if self.step % self._config.checkpoint_every == 0 or self.step >= self._config.steps:
            self._best.keep(self._agent)
        state = {
            "model": self._agent.model.state_dict(),
            "learner": self._learner.state_dict(),
            "replay": self._replay.state_dict(),
            "collector": self._collector.state_dict(),
            "policy_state": self._collector.policy_state,
            "num_updates": self._num_updates,
            "means": self._means.state_dict(),
            "best": self._best.state_dict(),
        }
        self._agent.save_pretrained(self._out / MODEL_FOLDER)
        save_checkpoint(self._out, self.step, state, keep=1)
        self._since_saved = 0
        self._replay.delete_evicted()

    def _collect(self, logger: MetricsLogger) -> None:
        is_prefill = self.step < self._config.prefill_steps
        finished = self._collector.step(self._wander if is_prefill else self._explore)
        self.step += 1
        if finished is not None:
            self._replay.add(finished.replay)
            logger.log(self.step, finished.record.metrics())
            if self.step - finished.record.num_steps >= self._config.prefill_steps:
                self._best.add(finished.record)

    def _wander(self, obs: Mapping[str, np.ndarray], state: int | None) -> tuple[np.ndarray, int]:
        seed = derive_seed(self._config.seed, "prefill", self._collector.num_episodes)
        return make_random_policy(seed, self._agent.spaces.action_dim)(obs, state)

    def _explore(self, obs: Mapping[str, np.ndarray], state: State | int | None) -> tuple[np.ndarray, State]:
        if not isinstance(state, dict):  # an episode begins, or the prefill ended in the middle of one
            seed = torch_seed(self._config.seed, "explore", self._collector.num_episodes)
            state = self._agent.initial_state(seed)
        return self._agent.act(obs, state, explore=True)


class _Means:
    """Means of metrics since they were last taken."""

    def __init__(self, state: Mapping[str, list[float]] | None = None) -> None:
        self._sums: dict[str, list[float]] = {k: list(v) for k, v in (state or {}).items()}

    def add(self, values: Mapping[str, float]) -> None:
        for key, value in values.items():
            total, count = self._sums.get(key, (0.0, 0.0))
            self._sums[key] = [total + value, count + 1]

    def take(self) -> Metrics:
        means = {key: total / count for key, (total, count) in self._sums.items()}
        self._sums = {}
        return means

    def state_dict(self) -> dict[str, list[float]]:
        return self._sums
