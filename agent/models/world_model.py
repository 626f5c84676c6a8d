"""The world model: observation model, memory and heads, and the loss that trains them.

Owns no optimizer and never touches what perceives: the visual input arrives detached.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F

from agent.config import WorldModelConfig
from agent.models.contrast import Contrast
from agent.models.distributions import categorical_entropy
from agent.models.nets import make_mlp
from agent.models.observation import ObservationModel
from agent.models.readout import half_square, make_head, make_readout
from agent.models.rssm import RSSM, Latent, balanced_kl

Metrics = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class ModelBatch:
    """Sequences as the world model sees them: ``action[:, t]`` led to step t and ``reward[:, t]``."""

    visual: Float[Tensor, "B T ..."]
    """What is seen: tokens, pixels or a vector, as the observation model wants it."""
    target: Float[Tensor, "B T ..."]
    """What must be told again; ``visual`` itself where nothing was augmented."""
    task: Float[Tensor, "B T P"]
    action: Float[Tensor, "B T A"]
    reward: Float[Tensor, "B T"]
    is_first: Bool[Tensor, "B T"]
    is_terminal: Bool[Tensor, "B T"]
    key: Float[Tensor, "B T V"] | None = None
    """Another encoder's view of the frames, which the state must find; none where nothing is contrasted."""


class WorldModel(nn.Module):
    """Observation model, RSSM, decoder of the task observation, reward and discount heads.

    Args:
        config: Sizes and losses.
        observation: Takes in what is seen, and tells it again.
        action_dim: Of the environment.
        key_dim: Width of what states are contrasted with; none if they are not.

    Source: Eq. 4, Eq. 5, Table 3.
    """

    def __init__(
        self,
        config: WorldModelConfig,
        observation: ObservationModel,
        *,
        action_dim: int,
        key_dim: int | None = None,
    ) -> None:
        super().__init__()
        self.config = config
        head, task = config.head, config.task
        assert task.scale is not None, "whoever knows the environment says how large its task observation is"
        task_dim = len(task.scale)
        self.observation = observation
        self.rssm = RSSM(config.rssm, observation.embed_dim, action_dim)
        feat_dim = self.rssm.feat_dim
        self.task_decoder = make_mlp(feat_dim, task.units, task.layers, task_dim)
        self.reward_readout = make_readout(config.reward_transform)
        self.reward_head = make_head(feat_dim, head, self.reward_readout)
        self.discount_head = make_mlp(feat_dim, head.units, head.layers, 1)
        self.contrast = None if key_dim is None else Contrast(feat_dim, key_dim)
        self.register_buffer("task_scale", torch.tensor(task.scale), persistent=False)
        self.task_scale: Tensor

    def embed(self, visual: Float[Tensor, "B ..."], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """What the RSSM sees of one step; ``task`` in its own units."""
        return self.observation.embed(visual, task / self.task_scale)

    def predict_reward(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """Reward for arriving in a state, in the environment's units."""
        return self.reward_readout.value(self.reward_head(feat))

    def predict_discount(self, feat: Float[Tensor, "*B F"]) -> Float[Tensor, "*B"]:
        """Gamma where the episode goes on from a state, 0 where it has terminated."""
        return self.discount_head(feat).squeeze(-1).float().sigmoid()


def world_model_loss(
    model: WorldModel, batch: ModelBatch, generator: torch.Generator
) -> tuple[Float[Tensor, ""], Metrics, Latent]:
    """Weighted sum of the loss terms, each term as a metric, and the posterior states.

    Source: Eq. 5, minimised; method notes, decisions 16 to 18 and 21.
    """
    embed = model.embed(batch.visual.flatten(0, 1), batch.task.flatten(0, 1))
    post, prior_logit = model.rssm.observe(
        embed.unflatten(0, batch.reward.shape),
        batch.action,
        batch.is_first,
        model.rssm.initial(len(embed) // batch.reward.shape[1]),
        generator,
    )
    kl_loss, kl = balanced_kl(
        post.logit, prior_logit, balance=model.config.kl_balance, free_nats=model.config.free_nats
    )
    losses = reconstruction_losses(model, batch, embed, post) | {"kl": kl_loss.mean()}
    scales = dataclasses.asdict(model.config.loss_scales)
    assert losses.keys() <= scales.keys()
    loss = torch.stack([scales[name] * value for name, value in losses.items()]).sum()
    metrics = {f"wm/{name}_loss": value for name, value in losses.items()}
    metrics |= {
        "wm/loss": loss,
        "wm/kl": kl.mean(),
        "wm/post_entropy": categorical_entropy(post.logit.detach()).mean(),
        "wm/prior_entropy": categorical_entropy(prior_logit.detach()).mean(),
    }
    return loss, as_floats(metrics), post


def as_floats(metrics: Mapping[str, Tensor]) -> Metrics:
    """Scalars as numbers, all in one go: each on its own would make a GPU wait."""
    values = torch.stack([value.detach().float() for value in metrics.values()])
    return dict(zip(metrics, values.tolist(), strict=True))


def reconstruction_losses(
    model: WorldModel, batch: ModelBatch, embed: Float[Tensor, "BT E"], post: Latent
) -> dict[str, Float[Tensor, ""]]:
    """What state and embedding must tell: what was seen, task observation, reward, discount, the key."""
    feat, config = post.feat, model.config
    target = batch.target.flatten(0, 1).detach()
    discount = config.discount * (~batch.is_terminal).to(feat.dtype)
    losses = model.observation.losses(target, embed, feat.flatten(0, 1))
    if model.contrast is not None and batch.key is not None:
        losses["contrast"] = model.contrast.loss(feat.flatten(0, 1), batch.key.flatten(0, 1))
    return losses | {
        "task": half_square(model.task_decoder(feat) - batch.task / model.task_scale).sum(-1).mean(),
        "reward": model.reward_readout.loss(model.reward_head(feat), batch.reward).mean(),
        "discount": F.binary_cross_entropy_with_logits(model.discount_head(feat).squeeze(-1), discount),
    }
