"""What the training loop, evaluation and files ask of a system, whatever it learns by."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from agent.config import AgentConfig
from agent.models.world_model import Metrics
from agent.replay import Replay
from langwm_data.config_io import ConfigError

State = dict[str, Any]
"""What a model remembers within an episode: tensors, numbers, and dicts of them, as a checkpoint holds."""


@dataclass(frozen=True)
class Spaces:
    """What a system must know of an environment."""

    height: int
    width: int
    task_dim: int
    action_dim: int

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
        return cls(height, width, shapes["task"][0], action.shape[0])  # pyright: ignore[reportOptionalSubscript]


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
    needs_labels: Callable[[AgentConfig], bool] = lambda config: False
    """Whether the environment must label objects while it learns."""
    note: str = ""
    """What a table has to say about this row: where it differs from the others in what it gets."""
