"""The training loop of stage three: collect, update, log, save.

Owns the order of events and what a checkpoint holds. Every random number is derived from the seed and
a counter, so a run that was killed at any moment goes on from its last checkpoint with the same numbers.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from agent.config import AgentConfig
from agent.envs.pointnav import PointNavEnv
from agent.models.world_model import Metrics
from agent.replay import Replay
from agent.rollout import Collector, EpisodeRecord
from agent.systems.controls import make_random_policy
from agent.systems.features import TokenCache
from agent.systems.finetune import Finetuner
from agent.systems.langwm import Agent, AgentState, LanGWM
from agent.systems.learner import Learner
from langwm_data.config_io import ConfigError, claim_output
from langwm_data.seeding import derive_seed, make_rng
from pretrain.checkpoint import latest_checkpoint, load_checkpoint, save_checkpoint
from pretrain.interrupt import stop_requests
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.metrics import MetricsLogger
from pretrain.model_file import MODEL_FOLDER
from pretrain.train import usable_device
from pretrain.update import torch_seed

log = logging.getLogger(__name__)

REPLAY_FOLDER = "replay"
Progress = Callable[[int, int], None]


def train_agent(
    config: AgentConfig,
    out: Path,
    *,
    fresh: bool = False,
    progress: Progress | None = None,
    env: gymnasium.Env | None = None,
) -> Path:
    """Train an agent, going on where an earlier call stopped.

    Args:
        config: Everything about the run.
        out: Folder of the run.
        fresh: Throw away what ``out`` holds first.
        progress: Called with environment steps done and in all.
        env: Learn in this environment instead of the training floors. It must be deterministic and
            have the observation, action and ``info`` of ``PointNavEnv``. It is closed at the end.

    Returns:
        ``out``; ``Agent.from_pretrained`` reads it.

    Raises:
        ConfigError: If the request cannot be carried out; nothing was changed then.
        KeyboardInterrupt: After SIGINT or SIGTERM, once everything is saved.
        FloatingPointError: If training diverges.
    """
    check_config(config)
    mae, text = make_mae(config)
    claim_output(out, config, fresh=fresh, may_differ=("steps", "eval_episodes"))
    if is_finished(config, out):
        log.info("%s has finished its %d steps; --fresh starts over", out, config.steps)
        return out
    env = env or PointNavEnv(config.env if text is None else replace(config.env, with_labels=True))
    try:
        run = _Run(config, out, env, mae, text)
        with MetricsLogger(out, run.step) as logger, stop_requests() as stop:
            while run.step < config.steps and not stop.is_set():
                run.advance(logger)
                if run.step % config.checkpoint_every == 0 and not run.is_pretraining:
                    run.save()
                if progress is not None:
                    progress(run.step, config.steps)
            run.save()
    finally:
        env.close()
    if stop.is_set():
        raise KeyboardInterrupt
    return out


def check_config(config: AgentConfig) -> None:
    """Refuse what cannot work before anything is written.

    Raises:
        ConfigError: Naming the field, its value and what is allowed.
    """
    usable_device(config.device)
    if config.features == "frozen" and config.mae is None:
        raise ConfigError(
            "features 'frozen' needs a pretrained MAE; give --mae RUN, or --features finetuned to learn"
            " one from what the agent sees"
        )


def make_mae(config: AgentConfig) -> tuple[LanguageGroundedMAE, FrozenText | None]:
    """The MAE, pretrained or new, and the text encoder where it goes on learning.

    Raises:
        ConfigError: If there is no such MAE or text encoder, or the MAE reads frames of another size.
    """
    if config.mae is not None:
        mae = LanguageGroundedMAE.from_pretrained(config.mae).to(config.device)
        text = FrozenText(mae.text, config.device) if config.features == "finetuned" else None
    else:
        text = FrozenText(config.finetune.text, config.device)
        with torch.random.fork_rng([]):
            torch.manual_seed(torch_seed(config.seed, "mae weights"))
            mae = LanguageGroundedMAE(config.finetune.model, config.finetune.text, text.null_text)
        mae = mae.to(config.device)
    camera, wanted = config.env.camera, mae.config
    if (camera.height, camera.width) != (wanted.height, wanted.width):
        raise ConfigError(
            f"env.camera is {camera.height} x {camera.width} pixels but the MAE reads"
            f" {wanted.height} x {wanted.width}; make them equal"
        )
    return mae, text


def is_finished(config: AgentConfig, out: Path) -> bool:
    """Whether the run in ``out`` has taken all its steps."""
    folder = latest_checkpoint(out)
    return folder is not None and int(folder.name.removeprefix("step-")) >= config.steps


class _Run:
    """Everything that learns, collects and remembers in one run."""

    def __init__(
        self,
        config: AgentConfig,
        out: Path,
        env: gymnasium.Env,
        mae: LanguageGroundedMAE,
        text: FrozenText | None,
    ) -> None:
        self._config = config
        self._out = out
        self.step = 0
        self._num_updates = 0
        self._means = _Means()
        model = _make_model(config, mae, env)
        cache = TokenCache(mae, config.token_cache_mib) if text is None else None
        encode = cache.encode if cache else mae.encode
        self._agent = Agent(model, config.env, encode)
        self._learner = Learner(model, config, encode)
        seed = config.seed
        self._finetuner = None if text is None else Finetuner(mae, text, config.finetune, seed=seed)
        self._random = make_random_policy(derive_seed(seed, "prefill"))
        state = self._load()
        self._replay = Replay(config.replay, out / REPLAY_FOLDER, state.get("replay"))
        first_seed = derive_seed(seed, "episodes") % 2**31
        self._collector = Collector(env, seed=first_seed, state=state.get("collector"))
        if held := state.get("policy_state"):
            self._collector.policy_state = held if isinstance(held, int) else AgentState.from_dict(held)

    @property
    def is_pretraining(self) -> bool:
        """Whether the new MAE still learns from the prefilled replay alone."""
        config = self._config
        is_needed = self._finetuner is not None and config.mae is None and self._replay.num_episodes > 0
        if not is_needed or self.step < config.prefill_steps:
            return False
        return self._finetuner.num_updates < config.finetune.pretrain_updates  # pyright: ignore[reportOptionalMemberAccess]

    def advance(self, logger: MetricsLogger) -> None:
        """Do the next thing: an update of the new MAE, or a step and, where due, an update of all."""
        config = self._config
        if self.is_pretraining:
            self._pretrain(logger)
            return
        start = time.perf_counter()
        self._collect(logger)
        self._means.add({"time/env_step_s": time.perf_counter() - start})
        is_due = self.step >= config.prefill_steps and self.step % config.update_every == 0
        if is_due and self._replay.num_episodes > 0 and not self.is_pretraining:
            start = time.perf_counter()
            metrics = self._update()
            self._means.add(metrics | {"time/update_s": time.perf_counter() - start})
            if self._num_updates % config.log_every == 0:
                logger.log(self.step, self._means.take())

    def save(self) -> None:
        """Write the model and, last, the checkpoint."""
        held = self._collector.policy_state
        state = {
            "model": self._agent.model.state_dict(),
            "learner": self._learner.state_dict(),
            "finetuner": self._finetuner.state_dict() if self._finetuner else None,
            "replay": self._replay.state_dict(),
            "collector": self._collector.state_dict(),
            "policy_state": held.to_dict() if isinstance(held, AgentState) else held,
            "num_updates": self._num_updates,
            "means": self._means.state_dict(),
        }
        self._agent.save_pretrained(self._out / MODEL_FOLDER)
        save_checkpoint(self._out, self.step, state, keep=1)
        self._replay.delete_evicted()

    def _load(self) -> dict[str, Any]:
        folder = latest_checkpoint(self._out)
        if folder is None:
            return {}
        self.step, state = load_checkpoint(folder, self._agent.model.device)
        self._agent.model.load_state_dict(state["model"])
        self._learner.load_state_dict(state["learner"])
        if self._finetuner is not None:
            self._finetuner.load_state_dict(state["finetuner"])
        self._num_updates = state["num_updates"]
        self._means = _Means(state["means"])
        return state

    def _collect(self, logger: MetricsLogger) -> None:
        is_prefill = self.step < self._config.prefill_steps
        finished = self._collector.step(self._random if is_prefill else self._explore)
        self.step += 1
        if finished is not None:
            self._replay.add(finished.replay)
            logger.log(self.step, episode_metrics(finished.record))

    def _explore(
        self, obs: Mapping[str, np.ndarray], state: AgentState | int | None
    ) -> tuple[np.ndarray, AgentState]:
        if not isinstance(state, AgentState):  # an episode begins, or the prefill ended in the middle of one
            seed = torch_seed(self._config.seed, "explore", self._collector.num_episodes)
            state = self._agent.initial_state(seed)
        return self._agent.act(obs, state, explore=True)

    def _update(self) -> Metrics:
        config, index = self._config, self._num_updates
        batch = self._replay.sample(
            make_rng(config.seed, "replay", index), config.batch_size, config.batch_length
        )
        metrics = self._finetuner.update(batch.frames()) if self._finetuner else {}
        self._num_updates += 1
        return metrics | self._learner.update(batch, index)

    def _pretrain(self, logger: MetricsLogger) -> None:
        config, finetuner = self._config, self._finetuner
        assert finetuner is not None
        rng = make_rng(config.seed, "mae pretraining", finetuner.num_updates)
        batch = self._replay.sample(rng, config.batch_size, config.batch_length)
        self._means.add(finetuner.update(batch.frames()))
        if not self.is_pretraining:
            logger.log(self.step, self._means.take())


def _make_model(config: AgentConfig, mae: LanguageGroundedMAE, env: gymnasium.Env) -> LanGWM:
    spaces = env.observation_space
    assert isinstance(spaces, gymnasium.spaces.Dict), "observations are a Dict"
    task_shape, scale = spaces["task"].shape, config.world_model.task.scale
    if task_shape != (len(scale),):
        raise ConfigError(
            f"world_model.task.scale has {len(scale)} entries but the environment's task observation has"
            f" shape {task_shape}; give one number for each entry"
        )
    shape = env.action_space.shape
    assert shape is not None
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "agent weights"))
        model = LanGWM(mae, config.world_model, config.behavior, action_dim=shape[0])
    return model.to(config.device)


def episode_metrics(record: EpisodeRecord) -> Metrics:
    """Scalars of one finished episode, as they are logged."""
    return {
        "env/return": record.total_reward,
        "env/success": float(record.success),
        "env/spl": record.spl,
        "env/soft_spl": record.soft_spl,
        "env/distance_to_goal": record.distance_to_goal,
        "env/geodesic_distance": record.geodesic_distance,
        "env/collisions": float(record.collisions),
        "env/length": float(record.num_steps),
    }


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
