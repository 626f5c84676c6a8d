"""LanGWM: the language-grounded MAE's features, a world model on them, and an actor-critic.

Owns how the three modules act together and the files in which an agent is handed on. How they are
trained stands in ``learner``.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from agent.config import BehaviorConfig, EnvConfig, WorldModelConfig
from agent.models.actor_critic import ActorCritic
from agent.models.rssm import Latent
from agent.models.world_model import WorldModel
from langwm_data import atomic
from langwm_data.config_io import ConfigError, build_config, config_to_dict
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, TextConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.model_file import MODEL_FOLDER
from pretrain.update import torch_seed

SCHEMA_VERSION = 1
CONFIG_FILE = "config.json"
WEIGHTS_FILE = "model.safetensors"

Encode = Callable[[Tensor], Tensor]
"""Frames (B, H, W, 3) uint8 to the MAE's tokens."""


class LanGWM(nn.Module):
    """The three modules of one agent; nothing flows back from a later one into an earlier one."""

    def __init__(
        self,
        mae: LanguageGroundedMAE,
        world_model: WorldModelConfig,
        behavior: BehaviorConfig,
        *,
        action_dim: int,
    ) -> None:
        super().__init__()
        self.mae = mae
        self.world_model = WorldModel(
            world_model,
            num_tokens=1 + mae.config.num_patches,
            token_dim=mae.config.dim,
            task_dim=len(world_model.task.scale),
            action_dim=action_dim,
        )
        self.behavior = ActorCritic(behavior, self.world_model.rssm.feat_dim, action_dim)

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return self.mae.device

    @property
    def action_dim(self) -> int:
        """Entries of an action."""
        return self.world_model.rssm.action_dim


@dataclass(frozen=True, kw_only=True)
class AgentState:
    """What an agent remembers between two steps of an episode."""

    latent: Latent
    action: Float[Tensor, "1 A"]
    """The action taken last."""
    seed: int
    step: int
    """Seed and step give the random numbers of the next step: the same state acts the same way."""

    def to_dict(self) -> dict[str, Any]:
        """Tensors and numbers for a checkpoint."""
        return {"latent": vars(self.latent), "action": self.action, "seed": self.seed, "step": self.step}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "AgentState":
        """Read back ``to_dict``."""
        return cls(**{**values, "latent": Latent(**values["latent"])})


class Agent:
    """A trained agent: observations in, actions out.

    >>> agent = Agent.from_pretrained("runs/agent")  # doctest: +SKIP
    >>> action, state = agent.act(obs)  # doctest: +SKIP
    >>> action, state = agent.act(obs, state)  # doctest: +SKIP

    Args:
        model: The modules.
        env: The environment they were trained in.
        encode: Frames to tokens; the MAE's own when None.
    """

    def __init__(self, model: LanGWM, env: EnvConfig, encode: Encode | None = None) -> None:
        self.model = model
        self.env = env
        self._encode = encode or model.mae.encode

    def initial_state(self, seed: int = 0) -> AgentState:
        """The state before the first observation of an episode."""
        latent = self.model.world_model.rssm.initial(1)
        action = latent.deter.new_zeros(1, self.model.action_dim)
        return AgentState(latent=latent, action=action, seed=seed, step=0)

    def act(
        self, obs: Mapping[str, np.ndarray], state: AgentState | None = None, *, explore: bool = False
    ) -> tuple[np.ndarray, AgentState]:
        """Choose the next action.

        Frames are encoded without masks and with the empty caption. The latent is sampled, the action
        is the policy's mode, or a sample of it when exploring. Source: DreamerV2.

        Args:
            obs: ``rgb`` and ``task`` of one step.
            state: What the last call of this episode returned; None begins an episode.
            explore: Sample the action.

        Raises:
            ValueError: If the frame is of another size than the agent was trained on.
        """
        state = state or self.initial_state()
        device = self.model.device
        generator = torch.Generator(device).manual_seed(torch_seed(state.seed, "act", state.step))
        self._be_evaluated()
        with torch.no_grad():
            latent = self._observe(obs, state, generator)
            policy = self.model.behavior.policy(latent.feat)
            action = policy.rsample(generator) if explore else policy.mode
        after = AgentState(latent=latent, action=action, seed=state.seed, step=state.step + 1)
        return action[0].cpu().numpy(), after

    def _be_evaluated(self) -> None:
        """Dropout off; setting the mode anew at every step would take longer than the memory's step."""
        for module in self.model.children():
            if module.training:
                module.eval()

    def _observe(
        self, obs: Mapping[str, np.ndarray], state: AgentState, generator: torch.Generator
    ) -> Latent:
        world_model, device = self.model.world_model, self.model.device
        rgb = torch.from_numpy(np.ascontiguousarray(obs["rgb"]))[None].to(device)
        task = torch.from_numpy(np.asarray(obs["task"], dtype=np.float32))[None].to(device)
        embed = world_model.embed(self._encode(rgb), task)
        is_first = torch.tensor([[state.step == 0]], device=device)
        post, _ = world_model.rssm.observe(
            embed[:, None], state.action[:, None], is_first, state.latent, generator
        )
        return post.at(0)

    def save_pretrained(self, folder: Path) -> None:
        """Write ``config.json`` and ``model.safetensors``, the weights first."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / CONFIG_FILE).unlink(missing_ok=True)
        model = self.model
        tensors = {name: t.detach().cpu().contiguous() for name, t in model.state_dict().items()}
        with atomic.atomic_path(folder / WEIGHTS_FILE) as temporary:
            save_file(tensors, temporary)
        parts = {
            "mae": model.mae.config,
            "text": model.mae.text,
            "world_model": model.world_model.config,
            "behavior": model.behavior.config,
            # Where baked scenes lay while it was trained is nothing to whoever is handed the agent.
            "env": replace(self.env, scenes=replace(self.env.scenes, baked=None)),
        }
        held = {name: config_to_dict(part) for name, part in parts.items()}
        header = {"schema_version": SCHEMA_VERSION, "system": "langwm", "action_dim": model.action_dim}
        atomic.write_json(folder / CONFIG_FILE, header | held)

    @classmethod
    def from_pretrained(cls, folder: Path | str, device: str = "cpu") -> "Agent":
        """Read what ``save_pretrained`` wrote, from its folder or from the run that holds it.

        Raises:
            ValueError: If there is no agent, or it is damaged or of another version.
        """
        folder = Path(folder)
        if (folder / MODEL_FOLDER / CONFIG_FILE).is_file():
            folder = folder / MODEL_FOLDER
        held = _read_config(folder)
        try:
            tensors = load_file(folder / WEIGHTS_FILE)
        except (OSError, SafetensorError) as error:
            raise ValueError(f"{folder / WEIGHTS_FILE} cannot be read: {error}") from error
        null = TextTokens(embed=tensors["mae.null_embed"], attend=tensors["mae.null_attend"])
        mae = LanguageGroundedMAE(held["mae"], held["text"], null)
        model = LanGWM(mae, held["world_model"], held["behavior"], action_dim=held["action_dim"])
        model.load_state_dict(tensors)
        return cls(model.to(device).eval(), held["env"])


_PARTS: Mapping[str, type] = {
    "mae": MAEConfig,
    "text": TextConfig,
    "world_model": WorldModelConfig,
    "behavior": BehaviorConfig,
    "env": EnvConfig,
}


def _read_config(folder: Path) -> dict[str, Any]:
    path = folder / CONFIG_FILE
    if not path.is_file():
        raise ValueError(f"{str(folder)!r} holds no trained agent ({CONFIG_FILE} and {WEIGHTS_FILE})")
    try:
        held = json.loads(path.read_text("utf-8"))
        version = held["schema_version"]
        if version != SCHEMA_VERSION:
            raise ValueError(f"{path} has schema version {version}; this program reads {SCHEMA_VERSION}")
        return held | {name: build_config(part, held[name]) for name, part in _PARTS.items()}
    except (json.JSONDecodeError, KeyError, TypeError, ConfigError) as error:
        raise ValueError(f"{path} does not describe a trained agent: {error}") from error
