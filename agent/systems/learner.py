"""How a dreamer learns: one step each of the world model and of actor and critic, in this order.

Owns these three optimizers. What perceives is trained elsewhere or not at all.
"""

from typing import Any

import torch
from jaxtyping import Float

from agent.config import AgentConfig
from agent.models.actor_critic import (
    actor_loss,
    behavior_metrics,
    critic_loss,
    imagine,
)
from agent.models.nets import frozen
from agent.models.rssm import Latent
from agent.models.world_model import Metrics, ModelBatch, world_model_loss
from agent.replay import Replay, ReplayBatch
from agent.systems.dreamer import Dreamer
from agent.systems.system import Learner
from langwm_data.seeding import make_rng
from pretrain.config import OptimConfig
from pretrain.optim import Optimizer
from pretrain.precision import autocast
from pretrain.update import torch_seed


class DreamerLearner(Learner):
    """Optimizers of world model, actor and critic.

    Random numbers depend on the seed and the number of the update alone, so an interrupted run goes
    on with the same losses.

    Source: Sec. 4.1 (optimised independently); method notes, decision 19 (one step each, in order).
    """

    def __init__(self, model: Dreamer, config: AgentConfig) -> None:
        self._model = model
        self._config = config
        self._device_type = model.device.type
        behavior = config.behavior
        learning = {
            "wm": (model.world_model, config.world_model.learning_rate),
            "actor": (model.behavior.actor, behavior.actor_learning_rate),
            "critic": (model.behavior.critic, behavior.critic_learning_rate),
        }
        self._optimizers = {n: Optimizer(module, _adam(config, lr)) for n, (module, lr) in learning.items()}

    def update(self, replay: Replay, index: int) -> Metrics:
        """Take update number ``index`` on a batch of its own; its metrics."""
        return self.update_on(self.sample(replay, index), index)

    def sample(self, replay: Replay, index: int) -> ReplayBatch:
        """The sequences of update number ``index``."""
        config = self._config
        return replay.sample(make_rng(config.seed, "replay", index), config.batch_size, config.batch_length)

    def update_on(
        self, batch: ReplayBatch, index: int, key: Float[torch.Tensor, "B T V"] | None = None
    ) -> Metrics:
        """Take update number ``index`` on ``batch``; its metrics.

        Args:
            batch: Sequences.
            index: The first is 0.
            key: What states are contrasted with, if they are.

        Raises:
            FloatingPointError: If a loss is not finite.
        """
        seed, device = self._config.seed, self._model.device
        generator = torch.Generator(device).manual_seed(torch_seed(seed, "update", index))
        with torch.random.fork_rng([] if device.type == "cpu" else [device], device_type=device.type):
            torch.manual_seed(torch_seed(seed, "dropout", index))
            post, metrics = self._update_world_model(batch.to(device), index, generator, key)
        is_alive = (~batch.is_terminal.to(device)).float().flatten()
        metrics |= self._update_behavior(post.detach().flatten_time(), is_alive, index, generator)
        if (index + 1) % self._config.behavior.slow_critic_every == 0:
            self._model.behavior.copy_to_slow_critic()
        return metrics

    def state_dict(self) -> dict[str, Any]:
        """Of the optimizers."""
        return {name: optimizer.state_dict() for name, optimizer in self._optimizers.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        for name, optimizer in self._optimizers.items():
            optimizer.load_state_dict(state[name])

    def _update_world_model(
        self, batch: ReplayBatch, index: int, generator: torch.Generator, key: torch.Tensor | None
    ) -> tuple[Latent, Metrics]:
        model = self._model.world_model.train()
        with self._autocast():
            perception, columns = self._model.perception, {"rgb": batch.rgb, **batch.features}
            target = perception.encode({name: column.flatten(0, 1) for name, column in columns.items()})
            target = target.unflatten(0, batch.reward.shape)
            seen = ModelBatch(
                visual=perception.augment(target, generator),
                target=target,
                task=batch.task,
                action=batch.action,
                reward=batch.reward,
                is_first=batch.is_first,
                is_terminal=batch.is_terminal,
                key=key,
            )
            loss, metrics, post = world_model_loss(model, seen, generator)
        return post, metrics | self._step("wm", loss, index)

    def _update_behavior(
        self, start: Latent, is_alive: torch.Tensor, index: int, generator: torch.Generator
    ) -> Metrics:
        model, behavior = self._model.world_model.eval(), self._model.behavior
        with self._autocast():
            with frozen(model):
                imagined = imagine(model, behavior, start, generator)
            actor, returns, weight = actor_loss(imagined, is_alive, behavior.config, behavior.return_scale)
            critic = critic_loss(behavior, imagined.feat, returns, weight)
        metrics = behavior_metrics(imagined, returns, actor, critic)
        if behavior.return_scale is not None:
            metrics["behavior/return_spread"] = behavior.return_scale.spread.item()
        return metrics | self._step("actor", actor, index) | self._step("critic", critic, index)

    def _step(self, name: str, loss: torch.Tensor, index: int) -> Metrics:
        taken = self._optimizers[name].step(loss, index)
        prefix = "wm/" if name == "wm" else f"behavior/{name}_"
        return {f"{prefix}grad_norm": taken["grad_norm"]}

    def _autocast(self) -> torch.autocast:
        return autocast(self._device_type, self._config.precision)


def _adam(config: AgentConfig, learning_rate: float) -> OptimConfig:
    shared = config.optimizer
    return OptimConfig(
        learning_rate=learning_rate, epsilon=shared.eps, max_grad_norm=shared.grad_clip, warmup_steps=0
    )
