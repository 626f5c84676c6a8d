"""CURL and RAD: soft actor-critic from augmented pixels, without a world model.

The two differ in one loss and in what is done to frames. CURL: crops, and a contrastive loss that makes two
crops of the same stack find each other. RAD: any augmentations, and nothing else.
"""

import copy
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from agent.config import AgentConfig
from agent.models.augmentation import Pixels, central_view, random_pair, random_view, view_size
from agent.models.nets import frozen
from agent.models.sac import (
    Actor,
    Critic,
    Transitions,
    actor_loss,
    alpha_loss,
    contrastive_loss,
    critic_loss,
    encoded_size,
    move_towards,
    target_value,
)
from agent.models.world_model import Metrics
from agent.replay import Replay, TransitionBatch
from agent.systems.system import Learner, Model, Spaces, State, make_system, task_scale
from langwm_data.config_io import ConfigError
from langwm_data.seeding import make_rng
from pretrain.precision import autocast
from pretrain.update import torch_seed


class SAC(Model):
    """Actor, critics and their slow copies.

    The state of acting holds the last frames of a stack, the episode's seed and its step.

    Raises:
        ConfigError: If the frames are too small for the convolutions.
    """

    task_scale: Tensor

    def __init__(self, config: AgentConfig, spaces: Spaces) -> None:
        super().__init__()
        self.config = config.sac
        self.spaces = spaces
        size = view_size(config.sac, spaces.height, spaces.width)
        if min(encoded_size(*size)) < 1:
            raise ConfigError(
                f"env.camera is {spaces.height} x {spaces.width} pixels, of which {size[0]} x {size[1]} are"
                " seen; the convolutions need 15 x 15"
            )
        self.critic = Critic(config.sac, size, spaces.task_dim, spaces.action_dim)
        self.target = copy.deepcopy(self.critic).requires_grad_(False)
        self.actor = Actor(config.sac, size, spaces.task_dim, spaces.action_dim)
        self.log_alpha = nn.Parameter(torch.tensor(config.sac.alpha).log())
        dim = config.sac.feature_dim
        self.bilinear = nn.Parameter(torch.rand(dim, dim)) if config.sac.is_contrastive else None
        self.register_buffer("task_scale", torch.tensor(task_scale(config, spaces)), persistent=False)

    @property
    def alpha(self) -> Tensor:
        """Weight of the entropy."""
        return self.log_alpha.exp()

    def initial_state(self, seed: int) -> State:
        """Nothing seen."""
        spaces = self.spaces
        frames = torch.zeros(self.config.frame_stack, spaces.height, spaces.width, 3, dtype=torch.uint8)
        return {"frames": frames, "seed": seed, "step": 0}

    def act(self, obs: Mapping[str, np.ndarray], state: State, *, explore: bool) -> tuple[np.ndarray, State]:
        """Choose the next action; see ``Model.act``. Without exploring it is the squashed mean."""
        frame = torch.from_numpy(np.ascontiguousarray(obs["rgb"]))
        before = frame.expand_as(state["frames"]) if state["step"] == 0 else state["frames"]
        frames = torch.cat([before[1:].cpu(), frame[None]])  # a checkpoint is read to the model's device
        task = torch.from_numpy(np.asarray(obs["task"], np.float32))[None].to(self.device)
        with torch.no_grad():
            view = central_view(frames[None].to(self.device), self.config)
            policy = self.actor(self.critic.encoder.convolve(view), task / self.task_scale)
            if explore:
                seed = torch_seed(state["seed"], "act", state["step"])
                action, _ = policy.rsample(torch.Generator(self.device).manual_seed(seed))
            else:
                action = policy.mode
        after = {"frames": frames, "seed": state["seed"], "step": state["step"] + 1}
        return action[0].cpu().numpy(), after


class SACLearner(Learner):
    """One update: critics, actor and alpha, slow copies, then the contrast.

    CURL's own code steps the encoder twice on the contrastive loss, with two optimizers; here it is once.

    Source: the public code of CURL and RAD.
    """

    def __init__(self, model: SAC, config: AgentConfig) -> None:
        self._model = model
        self._config = config
        sac = config.sac
        learning: dict[str, tuple[list[nn.Parameter], float, float]] = {
            "critic": (list(model.critic.parameters()), sac.learning_rate, 0.9),
            "actor": (list(model.actor.parameters()), sac.learning_rate, 0.9),
            "alpha": ([model.log_alpha], sac.alpha_learning_rate, 0.5),
        }
        if model.bilinear is not None:
            weights = [*model.critic.encoder.parameters(), model.bilinear]
            learning["contrast"] = (weights, sac.learning_rate, 0.9)
        self._optimizers = {
            name: torch.optim.Adam(weights, lr=rate, betas=(beta, 0.999), fused=True)
            for name, (weights, rate, beta) in learning.items()
        }

    def update(self, replay: Replay, index: int) -> Metrics:
        """Take update number ``index`` on transitions of its own; its metrics."""
        sac = self._config.sac
        rng = make_rng(self._config.seed, "replay", index)
        return self.update_on(replay.transitions(rng, sac.batch_size, sac.frame_stack), index)

    def update_on(self, batch: TransitionBatch, index: int) -> Metrics:
        """Take update number ``index`` on ``batch``; its metrics.

        Raises:
            FloatingPointError: If a loss or its gradient is not finite.
        """
        model, sac = self._model, self._config.sac
        seed = torch_seed(self._config.seed, "update", index)
        generator = torch.Generator(model.device).manual_seed(seed)
        batch = batch.to(model.device)
        seen = self._augment(batch, generator)
        metrics = self._update_critic(seen, generator, index)
        if index % sac.actor_every == 0:
            metrics |= self._update_actor(seen, generator, index)
        if index % sac.target_every == 0:
            move_towards(model.target.values, model.critic.values, sac.critic_tau)
            move_towards(model.target.encoder, model.critic.encoder, sac.encoder_tau)
        if model.bilinear is not None:
            positive, _ = random_view(batch.rgb[:, :-1], sac, generator)
            metrics |= self._update_contrast(seen.pixels, positive, index)
        return metrics

    def state_dict(self) -> dict[str, Any]:
        """Of the optimizers."""
        return {name: optimizer.state_dict() for name, optimizer in self._optimizers.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        for name, optimizer in self._optimizers.items():
            optimizer.load_state_dict(state[name])

    def _augment(self, batch: TransitionBatch, generator: torch.Generator) -> Transitions:
        pixels, next_pixels = random_pair(batch.rgb[:, :-1], batch.rgb[:, 1:], self._config.sac, generator)
        task = batch.task / self._model.task_scale
        return Transitions(
            pixels=pixels,
            next_pixels=next_pixels,
            task=task[:, 0],
            next_task=task[:, 1],
            action=batch.action,
            reward=batch.reward,
            is_terminal=batch.is_terminal,
        )

    def _update_critic(self, seen: Transitions, generator: torch.Generator, index: int) -> Metrics:
        model = self._model
        with torch.no_grad(), self._autocast():
            policy = model.actor(model.critic.encoder.convolve(seen.next_pixels), seen.next_task)
            action, log_prob = policy.rsample(generator)
            convolved = model.target.encoder.convolve(seen.next_pixels)
            next_values = model.target(convolved, seen.next_task, action)
        target = target_value(
            seen.reward,
            seen.is_terminal,
            next_values,
            log_prob,
            model.alpha.detach(),
            self._config.sac.discount,
        )
        with self._autocast():
            values = model.critic(model.critic.encoder.convolve(seen.pixels), seen.task, seen.action)
        loss = critic_loss(values, target)
        taken = self._step("critic", loss, index)
        return taken | {"sac/value": values.mean().item(), "sac/reward": seen.reward.mean().item()}

    def _update_actor(self, seen: Transitions, generator: torch.Generator, index: int) -> Metrics:
        model = self._model
        with self._autocast(), frozen(model.critic):
            convolved = model.critic.encoder.convolve(seen.pixels)
            action, log_prob = model.actor(convolved, seen.task).rsample(generator)
            values = model.critic(convolved, seen.task, action)
        taken = self._step("actor", actor_loss(values, log_prob, model.alpha), index)
        entropy = alpha_loss(model.log_alpha, log_prob, model.spaces.action_dim)
        taken |= self._step("alpha", entropy, index)
        return taken | {"sac/alpha": model.alpha.item(), "sac/entropy": -log_prob.mean().item()}

    def _update_contrast(self, anchor: Pixels, positive: Pixels, index: int) -> Metrics:
        model = self._model
        assert model.bilinear is not None
        with self._autocast():
            with torch.no_grad():
                keys = model.target.encoder(positive)
            loss = contrastive_loss(model.critic.encoder(anchor), keys, model.bilinear)
        return self._step("contrast", loss, index)

    def _step(self, name: str, loss: Tensor, index: int) -> Metrics:
        optimizer = self._optimizers[name]
        weights = optimizer.param_groups[0]["params"]
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = nn.utils.get_total_norm([w.grad for w in weights if w.grad is not None])
        if not torch.isfinite(norm):
            raise FloatingPointError(
                f"the {name} loss is {loss.item()} at update {index} and its gradient's norm {norm.item()};"
                f" try a learning rate below {optimizer.param_groups[0]['lr']}"
            )
        optimizer.step()
        return {f"sac/{name}_loss": loss.item(), f"sac/{name}_grad_norm": norm.item()}

    def _autocast(self) -> torch.autocast:
        return autocast(self._model.device, self._config.precision)


def _make_learner(model: Model, config: AgentConfig) -> SACLearner:
    return SACLearner(cast("SAC", model), config)


SYSTEM = make_system(
    SAC,
    _make_learner,
    note="sees RGB and the task observation; one update per environment step, not one in five",
)
"""CURL and RAD; their overlays say which."""
