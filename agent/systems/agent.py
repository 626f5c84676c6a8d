"""A trained agent of any system, and the two files in which it is handed on."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from agent.config import AgentConfig, EnvConfig
from agent.systems.features import Encoder
from agent.systems.registry import find_system
from agent.systems.system import Model, Spaces, State
from langwm_data import atomic
from langwm_data.config_io import ConfigError, build_config, config_to_dict
from pretrain.model_file import MODEL_FOLDER

SCHEMA_VERSION = 2
CONFIG_FILE = "config.json"
WEIGHTS_FILE = "model.safetensors"


class Agent:
    """A trained agent: observations in, actions out.

    >>> agent = Agent.from_pretrained("runs/agent")  # doctest: +SKIP
    >>> action, state = agent.act(obs)  # doctest: +SKIP
    >>> action, state = agent.act(obs, state)  # doctest: +SKIP

    Args:
        model: The weights.
        config: What they were trained with.
        spaces: Sizes of the environment's observations and actions.
    """

    def __init__(self, model: Model, config: AgentConfig, spaces: Spaces) -> None:
        self.model = model
        self.config = config
        self.spaces = spaces

    @property
    def system(self) -> str:
        """Its name in tables."""
        return self.config.system

    @property
    def env(self) -> EnvConfig:
        """The environment it was trained in."""
        return self.config.env

    def wrap_env(self, env: gymnasium.Env) -> gymnasium.Env:
        """``env`` as this agent must see it: with ``features`` where its system computes some.

        Raises:
            ConfigError: If what computes them is out of reach.
        """
        return find_system(self.system).wrap_env(self.config, env)

    def initial_state(self, seed: int = 0) -> State:
        """The state before the first observation of an episode."""
        return self.model.initial_state(seed)

    def act(
        self, obs: Mapping[str, np.ndarray], state: State | None = None, *, explore: bool = False
    ) -> tuple[np.ndarray, State]:
        """Choose the next action.

        Args:
            obs: ``rgb`` and ``task`` of one step, and ``features`` where ``wrap_env`` adds them.
            state: What the last call of this episode returned; None begins an episode.
            explore: Act as in training.

        Raises:
            ValueError: If the frame is of another size than in training, or ``features`` is missing.
        """
        shape, wanted = np.shape(obs["rgb"]), (self.spaces.height, self.spaces.width, 3)
        if shape != wanted:
            raise ValueError(f"obs['rgb'] has shape {shape}; this agent was trained on {wanted}")
        if self.spaces.feature_dim and "features" not in obs:
            raise ValueError(
                f"obs has no 'features', which system {self.system!r} acts on; step what Agent.wrap_env"
                " returns"
            )
        return self.model.act(obs, self.initial_state() if state is None else state, explore=explore)

    def save_pretrained(self, folder: Path) -> None:
        """Write ``config.json`` and ``model.safetensors``, the weights first.

        Raises:
            OSError: If the weights cannot be written, for instance on a full disk; what was there stays.
        """
        folder.mkdir(parents=True, exist_ok=True)
        tensors = {name: t.detach().cpu().contiguous() for name, t in self.model.state_dict().items()}
        with atomic.atomic_path(folder / WEIGHTS_FILE) as temporary:
            temporary.write_bytes(save(tensors))
            (folder / CONFIG_FILE).unlink(missing_ok=True)
        held = {
            "system": self.system,
            "spaces": asdict(self.spaces),
            "config": config_to_dict(self._config()),
        }
        atomic.write_json(folder / CONFIG_FILE, {"schema_version": SCHEMA_VERSION} | held)

    def _config(self) -> AgentConfig:
        """Where things lay while it was trained is nothing to whoever is handed the agent."""
        env = replace(self.env, scenes=replace(self.env.scenes, baked=None))
        return replace(self.config, env=env, mae=None)

    @classmethod
    def from_pretrained(
        cls, folder: Path | str, device: str = "cpu", *, encoder: Encoder | None = None
    ) -> "Agent":
        """Read what ``save_pretrained`` wrote, from its folder or from the run that holds it.

        Args:
            folder: Of the agent or of its run.
            device: Where it will act.
            encoder: The one that an agent of system ``own-encoder`` was trained with.

        Raises:
            ValueError: If there is no agent, it is damaged or of another version, or its encoder is missing.
        """
        folder = find_agent(folder)
        config, spaces = read_config(folder)
        system = find_system(config.system, encoder)
        try:
            tensors = load_file(folder / WEIGHTS_FILE)
        except (OSError, SafetensorError) as error:
            raise ValueError(f"{folder / WEIGHTS_FILE} cannot be read: {error}") from error
        try:
            model = system.restore(config, spaces, tensors)
        except (KeyError, RuntimeError) as error:
            raise ValueError(
                f"{folder / WEIGHTS_FILE} does not fit {CONFIG_FILE} beside it: {error}"
            ) from error
        return cls(model.to(device).eval(), config, spaces)


def find_agent(folder: Path | str) -> Path:
    """The folder of an agent's two files: that folder itself, or the one in a run."""
    inner = Path(folder) / MODEL_FOLDER
    return inner if (inner / CONFIG_FILE).is_file() else Path(folder)


def read_config(folder: Path) -> tuple[AgentConfig, Spaces]:
    """What an agent was trained with, without its weights; ``folder`` as ``find_agent`` gives it.

    Raises:
        ValueError: If there is no agent, or it is of another version.
    """
    path = folder / CONFIG_FILE
    if not path.is_file():
        raise ValueError(f"{str(folder)!r} holds no trained agent ({CONFIG_FILE} and {WEIGHTS_FILE})")
    try:
        held: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if "mae" in held:
            raise ValueError(f"{str(folder)!r} holds an autoencoder of pretrain-mae, not a trained agent")
        version = held["schema_version"]
        if version != SCHEMA_VERSION:
            raise ValueError(f"{path} has schema version {version}; this program reads {SCHEMA_VERSION}")
        return build_config(AgentConfig, held["config"]), build_config(Spaces, held["spaces"])
    except (json.JSONDecodeError, KeyError, TypeError, ConfigError) as error:
        raise ValueError(f"{path} does not describe a trained agent: {error}") from error
