"""Actor and critic, and the losses that train them in the world model's imagination."""

import copy
import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.config import BehaviorConfig
from agent.models.distributions import TruncatedNormal
from agent.models.loop import autocast_dtype
from agent.models.nets import make_linear, make_mlp
from agent.models.readout import make_head, make_readout
from agent.models.return_scale import ReturnScale
from agent.models.returns import lambda_return, step_weight
from agent.models.rssm import Latent
from agent.models.world_model import Metrics, WorldModel, as_floats

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
        self.value_readout = make_readout(config.value_transform)
        self.critic = make_head(feat_dim, config.critic, self.value_readout)
        self.slow_critic = copy.deepcopy(self.critic).requires_grad_(False)
        self.return_scale = ReturnScale() if config.return_scale == "percentile" else None

    def policy(self, feat: Float[Tensor, "*B F"]) -> TruncatedNormal:
        """Distribution of the next action."""
        mean, raw = self.actor(feat).float().chunk(2, -1)
        scale = (MAX_STD - MIN_STD) * raw.sigmoid() + MIN_STD
        return TruncatedNormal(mean.tanh(), scale)

    def value(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """Expected discounted sum of the rewards to come."""
        return self.value_readout.value(self.critic(feat))

    def slow_value(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """The same, by the slow critic."""
        return self.value_readout.value(self.slow_critic(feat))

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

    States are kept in the precision in which networks read them: cast once, not by each network anew.

    Source: DreamerV2 (the policy's input is detached).
    """
    dtype = autocast_dtype(start.deter)
    state, feats, actions, entropies = start, [start.feat.to(dtype)], [], []
    for _ in range(behavior.config.imag_horizon):
        policy = behavior.policy(feats[-1].detach())
        action = policy.rsample(generator)
        state = model.rssm.imagine_step(state, action, generator)
        feats.append(state.feat.to(dtype))
        actions.append(action)
        entropies.append(policy.entropy())
    left, reached = (
        torch.stack(feats[:-1], 1),
        torch.stack(feats[1:], 1),
    )  # whole: networks read slices slowly
    return Imagination(
        feat=left,
        action=torch.stack(actions, 1),
        entropy=torch.stack(entropies, 1),
        reward=model.predict_reward(reached),
        discount=model.predict_discount(reached),
        next_value=behavior.slow_value(reached),
    )


def actor_loss(
    imagined: Imagination,
    is_alive: Float[Tensor, " B"],
    config: BehaviorConfig,
    scale: ReturnScale | None = None,
) -> tuple[Float[Tensor, ""], Float[Tensor, "B T"], Float[Tensor, "B T"]]:
    """Negative weighted return plus entropy bonus; also the returns and the weights, both detached.

    Args:
        imagined: Steps of the policy.
        is_alive: 0 where imagination starts from a terminal state, else 1.
        config: Of the behaviour.
        scale: Follows the returns and divides them, if given.

    Source: Eq. 6; DreamerV2 (``actor_grad: dynamics``); DreamerV3 (scaled returns).
    """
    returns = lambda_return(imagined.reward, imagined.discount, imagined.next_value, config.lambda_)
    weight = step_weight(is_alive, imagined.discount).detach()
    wanted = returns if scale is None else returns / scale.follow(returns)
    loss = -(weight * (wanted + config.entropy_scale * imagined.entropy)).mean()
    return loss, returns.detach(), weight


def critic_loss(
    behavior: ActorCritic,
    feat: Float[Tensor, "B T F"],
    returns: Float[Tensor, "B T"],
    weight: Float[Tensor, "B T"],
) -> Float[Tensor, ""]:
    """Weighted loss of the value's head against the detached returns: half the squared error, or two-hot."""
    return (weight * behavior.value_readout.loss(behavior.critic(feat.detach()), returns)).mean()


def behavior_metrics(
    imagined: Imagination, returns: Float[Tensor, "B T"], actor: Tensor, critic: Tensor
) -> Metrics:
    """Scalars worth a curve."""
    return as_floats(
        {
            "behavior/actor_loss": actor,
            "behavior/critic_loss": critic,
            "behavior/entropy": imagined.entropy.mean(),
            "behavior/imagined_reward": imagined.reward.mean(),
            "behavior/imagined_return": returns.mean(),
            "behavior/imagined_discount": imagined.discount.mean(),
        }
    )
