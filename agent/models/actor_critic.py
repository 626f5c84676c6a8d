"""Actor and critic, and the losses that train them in the world model's imagination."""

import copy
import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.config import BehaviorConfig
from agent.models.distributions import TruncatedNormal
from agent.models.nets import make_linear, make_mlp
from agent.models.returns import lambda_return, step_weight
from agent.models.rssm import Latent
from agent.models.world_model import Metrics, WorldModel, half_square

MIN_STD = 0.1
MAX_STD = 1.0
"""Limits of the actor's scale. Source: MWM."""


class ActorCritic(nn.Module):
    """Policy and value of a state of the world model; ``slow_critic`` lags behind ``critic``.

    Source: Eq. 6, Table 3; MWM (scale of the actor).
    """

    def __init__(self, config: BehaviorConfig, feat_dim: int, action_dim: int) -> None:
        super().__init__()
        self.config = config
        self.actor = make_mlp(feat_dim, config.actor.units, config.actor.layers)
        self.actor.append(make_linear(config.actor.units, 2 * action_dim, gain=math.sqrt(0.1)))
        self.critic = make_mlp(feat_dim, config.critic.units, config.critic.layers, 1)
        self.slow_critic = copy.deepcopy(self.critic).requires_grad_(False)

    def policy(self, feat: Float[Tensor, "*B F"]) -> TruncatedNormal:
        """Distribution of the next action."""
        mean, raw = self.actor(feat).float().chunk(2, -1)
        scale = (MAX_STD - MIN_STD) * raw.sigmoid() + MIN_STD
        return TruncatedNormal(mean.tanh(), scale)

    def value(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """Expected discounted sum of the rewards to come."""
        return self.critic(feat).squeeze(-1).float()

    def slow_value(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """The same, by the slow critic."""
        return self.slow_critic(feat).squeeze(-1).float()

    def copy_to_slow_critic(self) -> None:
        """Let the slow critic catch up."""
        self.slow_critic.load_state_dict(self.critic.state_dict())


@dataclass(frozen=True, kw_only=True)
class Imagination:
    """Imagined steps from a batch of states. Step t leads from state t to state t + 1."""

    feat: Float[Tensor, "B T F"]
    """States 0 to T - 1, from which the actions were taken."""
    action: Float[Tensor, "B T A"]
    entropy: Float[Tensor, "B T"]
    """Of the policy at these states, in nats."""
    reward: Float[Tensor, "B T"]
    """For arriving in states 1 to T."""
    discount: Float[Tensor, "B T"]
    """Of states 1 to T."""
    next_value: Float[Tensor, "B T"]
    """By the slow critic, of states 1 to T."""


def imagine(
    model: WorldModel, behavior: ActorCritic, start: Latent, generator: torch.Generator
) -> Imagination:
    """Follow the policy through the prior. Gradients reach the actor through the dynamics.

    Source: DreamerV2 (the policy's input is detached).
    """
    state, feats, actions, entropies = start, [start.feat], [], []
    for _ in range(behavior.config.imag_horizon):
        policy = behavior.policy(feats[-1].detach())
        action = policy.rsample(generator)
        state = model.rssm.imagine_step(state, action, generator)
        feats.append(state.feat)
        actions.append(action)
        entropies.append(policy.entropy())
    feat = torch.stack(feats, 1)
    reached = feat[:, 1:]
    return Imagination(
        feat=feat[:, :-1],
        action=torch.stack(actions, 1),
        entropy=torch.stack(entropies, 1),
        reward=model.predict_reward(reached),
        discount=model.predict_discount(reached),
        next_value=behavior.slow_value(reached),
    )


def actor_loss(
    imagined: Imagination, is_alive: Float[Tensor, " B"], config: BehaviorConfig
) -> tuple[Float[Tensor, ""], Float[Tensor, "B T"], Float[Tensor, "B T"]]:
    """Negative weighted return plus entropy bonus; also the returns and the weights, both detached.

    Source: Eq. 6; DreamerV2 (``actor_grad: dynamics``).
    """
    returns = lambda_return(imagined.reward, imagined.discount, imagined.next_value, config.lambda_)
    weight = step_weight(is_alive, imagined.discount).detach()
    loss = -(weight * (returns + config.entropy_scale * imagined.entropy)).mean()
    return loss, returns.detach(), weight


def critic_loss(
    behavior: ActorCritic,
    feat: Float[Tensor, "B T F"],
    returns: Float[Tensor, "B T"],
    weight: Float[Tensor, "B T"],
) -> Float[Tensor, ""]:
    """Weighted half squared error of the value against the detached returns."""
    return (weight * half_square(behavior.value(feat.detach()) - returns)).mean()


def behavior_metrics(
    imagined: Imagination, returns: Float[Tensor, "B T"], actor: Tensor, critic: Tensor
) -> Metrics:
    """Scalars worth a curve."""
    return {
        "behavior/actor_loss": actor.item(),
        "behavior/critic_loss": critic.item(),
        "behavior/entropy": imagined.entropy.mean().item(),
        "behavior/imagined_reward": imagined.reward.mean().item(),
        "behavior/imagined_return": returns.mean().item(),
        "behavior/imagined_discount": imagined.discount.mean().item(),
    }
