"""What the training loop, evaluation and files ask of a system, whatever it learns by."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from agent.config import AgentConfig
from agent.envs.make import check_gives, make_env
from agent.models.world_model import Metrics
from agent.replay import Replay
from langwm_data.config_io import ConfigError
from pretrain.update import torch_seed

State = dict[str, Any]
"""What a model remembers within an episode: tensors, numbers, and dicts of them, as a checkpoint holds."""

UNBOUNDED = 5.0
"""Stands for the range of an entry that has none: metres to a goal in a home. Source: ours."""
_AS_GOOD_AS_UNBOUNDED = 1e4
"""Some environments bound a number by the largest float."""


@dataclass(frozen=True)
class Spaces:
    """What a system must know of an environment."""

    height: int
    width: int
    task_dim: int
    action_dim: int
    feature_dim: int = 0
    """Entries of ``features``, which ``System.wrap_env`` adds where a system wants them; else 0."""
    task_range: tuple[float, ...] | None = None
    """Greatest magnitude of each entry of the task observation, ``UNBOUNDED`` where there is none; None where
    nobody knows."""

    @classmethod
    def of(cls, env: gymnasium.Env) -> "Spaces":
        """Those of ``env``.

        Raises:
            ConfigError: If it has no ``rgb`` and ``task`` entries or no vector of bounded actions.
        """
        observation, action = env.observation_space, env.action_space
        entries = observation.spaces if isinstance(observation, gymnasium.spaces.Dict) else {}
        shapes = {name: entries[name].shape for name in ("rgb", "task") if name in entries}
        if len(shapes.get("rgb") or ()) != 3 or len(shapes.get("task") or ()) != 1:
            raise ConfigError(
                f"env observes {observation}; allowed: a Dict with rgb (H, W, 3) and task (numbers in a row)"
            )
        if not isinstance(action, gymnasium.spaces.Box) or len(action.shape) != 1:
            raise ConfigError(f"env has actions {action}; allowed: a Box with one axis")
        height, width, _ = shapes["rgb"]  # pyright: ignore[reportGeneralTypeIssues, reportOptionalIterable]
        feature_dim = math.prod(entries["features"].shape or ()) if "features" in entries else 0
        task = entries["task"]
        assert isinstance(task, gymnasium.spaces.Box)
        return cls(height, width, task.shape[0], action.shape[0], feature_dim, _range_of(task))


def _range_of(space: gymnasium.spaces.Box) -> tuple[float, ...]:
    most = np.maximum(np.abs(space.low), np.abs(space.high)).astype(np.float64)
    return tuple(value if 0 < value < _AS_GOOD_AS_UNBOUNDED else UNBOUNDED for value in most.tolist())


def task_scale(config: AgentConfig, spaces: Spaces) -> tuple[float, ...]:
    """What the entries of the task observation are divided by: as the config says, else their range.

    Raises:
        ConfigError: If the task observation has another size than the config says.
    """
    scale = config.world_model.task.scale
    if scale is None:
        return spaces.task_range or (1.0,) * spaces.task_dim
    if len(scale) != spaces.task_dim:
        raise ConfigError(
            f"world_model.task.scale has {len(scale)} entries but the environment's task observation has"
            f" {spaces.task_dim}; give one number for each entry,"
            " or null for what the environment says"
        )
    return scale


class Model(nn.Module, ABC):
    """The weights that acting needs: what is saved, handed on and scored."""

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return next(self.parameters()).device

    @abstractmethod
    def initial_state(self, seed: int) -> State:
        """The state before the first observation of an episode; its randomness comes from ``seed``."""

    @abstractmethod
    def act(self, obs: Mapping[str, np.ndarray], state: State, *, explore: bool) -> tuple[np.ndarray, State]:
        """An action in [-1, 1] and the state for the next step; explores as in training if asked.

        The same observation and state give the same action.

        Raises:
            ValueError: If the frame is of another size than the model was made for.
        """


class Learner(ABC):
    """How a model learns from the replay buffer.

    Every random number depends on the seed and the number of the update alone.
    """

    @property
    def is_pretrained(self) -> bool:
        """Whether nothing is left to learn from the prefilled buffer before ordinary updates begin."""
        return True

    def pretrain(self, replay: Replay) -> Metrics:
        """Take the next update before the ordinary ones; only where ``is_pretrained`` is False."""
        return {}

    @abstractmethod
    def update(self, replay: Replay, index: int) -> Metrics:
        """Take ordinary update number ``index``."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Optimizers and counters; the model's weights are saved beside it."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""


WrapEnv = Callable[[AgentConfig, gymnasium.Env], gymnasium.Env]


def keep_env(config: AgentConfig, env: gymnasium.Env) -> gymnasium.Env:
    """``env`` as it is."""
    return env


@dataclass(frozen=True, kw_only=True)
class System:
    """One row of a table: how its model is made, how it learns, what it needs."""

    create: Callable[[AgentConfig, Spaces], Model]
    """A new model with its first weights, on ``config.device``. Raises ``ConfigError``."""
    restore: Callable[[AgentConfig, Spaces, Mapping[str, Tensor]], Model]
    """A model with these weights, on the CPU; reads no file that ``config`` names."""
    resolve: Callable[[AgentConfig, Model], AgentConfig] = lambda config, model: config
    """``config`` as ``restore`` needs it, with what a file that it names has said."""
    make_learner: Callable[[Model, AgentConfig], Learner]
    wrap_env: WrapEnv = keep_env
    """The environment as the model must see it, in training and whenever it acts. May add ``features``, a
    vector that is computed once a step and kept in the replay. Raises ``ConfigError``."""
    reads_mae: bool = False
    """Whether ``mae`` and ``features`` of the config mean anything to it."""
    needs_labels: Callable[[AgentConfig], bool] = lambda config: False
    """Whether the environment must label objects while it learns, and the replay keeps them."""
    needs_depth: Callable[[AgentConfig], bool] = lambda config: False
    """Whether the replay keeps depth."""
    note: str = ""
    """What a table has to say about this row: where it differs from the others in what it gets."""

    def make_env(self, config: AgentConfig, env: gymnasium.Env | None = None) -> gymnasium.Env:
        """The environment to learn in, as the model must see it: ``env``, or the one that ``config`` names.

        Raises:
            ConfigError: If there is none, or it does not give what this system needs; it is closed then.
        """
        needs_labels = self.needs_labels(config)
        env = make_env(config.env, env, with_labels=needs_labels)
        try:
            labels = needs_labels or config.env.with_labels
            check_gives(env, config.system, labels=labels, depth=self.needs_depth(config))
            return self.wrap_env(config, env)
        except BaseException:
            env.close()
            raise


def make_system(
    assemble: Callable[[AgentConfig, Spaces], Model],
    make_learner: Callable[[Model, AgentConfig], Learner],
    *,
    wrap_env: WrapEnv = keep_env,
    note: str,
) -> System:
    """A system whose model is all its own: ``assemble`` makes it, from random weights of the global seed."""

    def create(config: AgentConfig, spaces: Spaces) -> Model:
        with torch.random.fork_rng([]):
            torch.manual_seed(torch_seed(config.seed, "agent weights"))
            return assemble(config, spaces).to(config.device)

    def restore(config: AgentConfig, spaces: Spaces, tensors: Mapping[str, Tensor]) -> Model:
        with torch.random.fork_rng([]):
            model = assemble(config, spaces)
        model.load_state_dict(tensors)
        return model

    return System(create=create, restore=restore, make_learner=make_learner, wrap_env=wrap_env, note=note)
