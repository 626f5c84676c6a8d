"""Agents that learn in the imagination of a world model: what they are and how they act.

Owns how perception, world model and behaviour act together. How they are trained stands in ``learner``.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.config import AgentConfig
from agent.models.actor_critic import ActorCritic
from agent.models.observation import ObservationModel
from agent.models.rssm import Latent
from agent.models.world_model import WorldModel
from agent.systems.system import Model, Spaces, State, task_scale
from pretrain.update import torch_seed


class Perception(nn.Module, ABC):
    """From an observation to what the world model sees; never trained by the world model's loss."""

    @abstractmethod
    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B ..."]:
        """What is seen in ``rgb`` (B, H, W, 3) uint8, and in whatever else a frame comes with."""

    def augment(
        self, visual: Float[Tensor, "B T ..."], generator: torch.Generator
    ) -> Float[Tensor, "B T ..."]:
        """What the world model is given of sequences while it learns; it must still tell ``visual`` again."""
        return visual


def make_dreamer(
    perception: Perception,
    observation: ObservationModel,
    config: AgentConfig,
    spaces: Spaces,
    *,
    key_dim: int | None = None,
) -> "Dreamer":
    """The three parts for an environment with these spaces; ``key_dim`` is ``WorldModel``'s.

    Raises:
        ConfigError: If the task observation has another size than the config says.
    """
    task = replace(config.world_model.task, scale=task_scale(config, spaces))
    sizes = replace(config.world_model, task=task)
    world_model = WorldModel(sizes, observation, action_dim=spaces.action_dim, key_dim=key_dim)
    behavior = ActorCritic(config.behavior, config.world_model.rssm.feat_dim, spaces.action_dim)
    return Dreamer(perception, world_model, behavior)


class Dreamer(Model):
    """Perception, world model and behaviour; nothing flows back from a later one into an earlier one.

    The state of acting holds the latent, the action taken last, the episode's seed and its step.
    """

    def __init__(self, perception: Perception, world_model: WorldModel, behavior: ActorCritic) -> None:
        super().__init__()
        self.perception = perception
        self.world_model = world_model
        self.behavior = behavior

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return self.world_model.task_scale.device

    def initial_state(self, seed: int) -> State:
        """Nothing seen, no action taken."""
        rssm = self.world_model.rssm
        latent = rssm.initial(1)
        action = latent.deter.new_zeros(1, rssm.action_dim)
        return {"latent": vars(latent), "action": action, "seed": seed, "step": 0}

    def act(self, obs: Mapping[str, np.ndarray], state: State, *, explore: bool) -> tuple[np.ndarray, State]:
        """Choose the next action; see ``Model.act``.

        The latent is sampled, the action is the policy's mode, or a sample of it when exploring.
        Source: DreamerV2.
        """
        generator = torch.Generator(self.device).manual_seed(torch_seed(state["seed"], "act", state["step"]))
        self._be_evaluated()
        with torch.no_grad():
            latent = self._observe(obs, state, generator)
            policy = self.behavior.policy(latent.feat)
            action = policy.rsample(generator) if explore else policy.mode
        after = {"latent": vars(latent), "action": action, "seed": state["seed"], "step": state["step"] + 1}
        return action[0].cpu().numpy(), after

    def _be_evaluated(self) -> None:
        """Dropout off; setting the mode anew at every step would take longer than the memory's step."""
        for module in self.children():
            if module.training:
                module.eval()

    def _observe(self, obs: Mapping[str, np.ndarray], state: State, generator: torch.Generator) -> Latent:
        model = self.world_model
        frame = {name: self._as_batch(value) for name, value in obs.items()}
        embed = model.embed(self.perception.encode(frame), frame["task"].float())
        is_first = torch.tensor([[state["step"] == 0]], device=self.device)
        before = Latent(**state["latent"])
        post, _ = model.rssm.observe(embed[:, None], state["action"][:, None], is_first, before, generator)
        return post.at(0)

    def _as_batch(self, value: Any) -> Tensor:  # noqa: ANN401
        return torch.from_numpy(np.ascontiguousarray(value))[None].to(self.device)
