"""Recurrent state-space model with discrete latents: the world model's memory.

Knows neither what it is fed nor what is read from its state. The paper writes p for what is called
``post`` here (the state after seeing the observation) and q for ``prior`` (the state predicted
before seeing it); DreamerV2's letters are the opposite.
"""

from dataclasses import dataclass, fields

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn

from agent.config import RSSMConfig
from agent.models.distributions import categorical_kl, mix_uniform, sample_straight_through
from agent.models.loop import LoopLinear, looping
from agent.models.nets import LayerNormGRUCell, make_linear, make_mlp


@dataclass(frozen=True)
class Latent:
    """State of the world model; ``stoch`` is a sample of the categoricals with these ``logit``."""

    deter: Float[Tensor, "*B H"]
    stoch: Float[Tensor, "*B S K"]
    logit: Float[Tensor, "*B S K"]

    @property
    def feat(self) -> Float[Tensor, "*B F"]:
        """What heads, actor and critic read: stochastic and deterministic part side by side."""
        return torch.cat([self.stoch.flatten(-2), self.deter], -1)

    def detach(self) -> "Latent":
        """The same state without its history."""
        return Latent(*(getattr(self, f.name).detach() for f in fields(self)))

    def flatten_time(self) -> "Latent":
        """A (B, T) batch of states as (B T) separate ones."""
        return Latent(*(getattr(self, f.name).flatten(0, 1) for f in fields(self)))

    def at(self, t: int) -> "Latent":
        """The states at step ``t`` of a (B, T) batch."""
        return Latent(*(getattr(self, f.name)[:, t] for f in fields(self)))


class RSSM(nn.Module):
    """Deterministic GRU path plus 32 categoricals of 32 classes.

    ``action[:, t]`` is the action that led to observation t.

    Source: Eq. 4 and Table 3 (sizes); DreamerV2 (everything else).
    """

    def __init__(self, config: RSSMConfig, embed_dim: int, action_dim: int) -> None:
        super().__init__()
        self.config = config
        num_logits = config.num_latents * config.num_classes
        self.feat_dim = config.feat_dim
        self.action_dim = action_dim
        self.stoch_in = make_linear(num_logits, config.hidden, kind=LoopLinear)
        self.action_in = nn.Linear(action_dim, config.hidden, bias=False)
        self.cell = LayerNormGRUCell(config.hidden, config.deter)
        self.prior_head = make_mlp(config.deter, config.hidden, 1, num_logits)
        self.post_deter = make_linear(config.deter, config.hidden, kind=LoopLinear)
        self.post_embed = nn.Linear(embed_dim, config.hidden, bias=False)
        self.post_out = make_linear(config.hidden, num_logits, kind=LoopLinear)

    def initial(self, batch: int) -> Latent:
        """The state before anything was seen: all zeros."""
        weight = self.post_out.weight
        shape = (batch, self.config.num_latents, self.config.num_classes)
        zeros = weight.new_zeros(shape)
        return Latent(weight.new_zeros(batch, self.config.deter), zeros, zeros)

    def observe(
        self,
        embed: Float[Tensor, "B T E"],
        action: Float[Tensor, "B T A"],
        is_first: Bool[Tensor, "B T"],
        state: Latent,
        generator: torch.Generator,
    ) -> tuple[Latent, Float[Tensor, "B T S K"]]:
        """Posterior states along a sequence, and the prior logits at the same steps.

        Only what depends on the previous step runs inside the loop: the projections of ``embed`` and
        ``action``, the prior and the gradients of weights are computed for all steps at once.
        """
        keep = (~is_first).to(embed.dtype)
        action_in = self.action_in(action * keep[..., None])
        embed_in = self.post_embed(embed)
        deters, stochs, logits = [], [], []
        deter, stoch = state.deter, state.stoch
        with looping(self.stoch_in, self.cell.linear, self.post_deter, self.post_out):
            for t in range(embed.shape[1]):
                gate = keep[:, t, None]
                deter = self._advance(deter * gate, stoch * gate[..., None], action_in[:, t])
                hidden = nn.functional.elu(self.post_deter(deter) + embed_in[:, t])
                logit = self._split(self.post_out(hidden))
                stoch = sample_straight_through(logit, generator)
                deters.append(deter)
                stochs.append(stoch)
                logits.append(logit)
        post = Latent(torch.stack(deters, 1), torch.stack(stochs, 1), torch.stack(logits, 1))
        return post, self._split(self.prior_head(post.deter))

    def imagine_step(self, state: Latent, action: Float[Tensor, "B A"], generator: torch.Generator) -> Latent:
        """The next state as the prior predicts it, without an observation."""
        deter = self._advance(state.deter, state.stoch, self.action_in(action))
        logit = self._split(self.prior_head(deter))
        return Latent(deter, sample_straight_through(logit, generator), logit)

    def _advance(self, deter: Tensor, stoch: Tensor, action_in: Tensor) -> Tensor:
        x = nn.functional.elu(self.stoch_in(stoch.flatten(-2)) + action_in)
        return self.cell(x, deter)

    def _split(self, logit: Tensor) -> Tensor:
        apart = rearrange(logit.float(), "... (s k) -> ... s k", s=self.config.num_latents)
        return mix_uniform(apart, self.config.unimix)


def balanced_kl(
    post_logit: Float[Tensor, "*B S K"],
    prior_logit: Float[Tensor, "*B S K"],
    *,
    balance: float,
    free_nats: float,
) -> tuple[Float[Tensor, "*B"], Float[Tensor, "*B"]]:
    """KL between posterior and prior, trained faster on the prior's side; and its plain value.

    Args:
        post_logit: Of the state after seeing the observation.
        prior_logit: Of the predicted state.
        balance: Share of the gradient that moves the prior towards the posterior.
        free_nats: Each element below this value is left alone.

    Source: DreamerV2 (balance 0.8); MWM (clipping per element).
    """
    to_prior = categorical_kl(post_logit.detach(), prior_logit)
    to_post = categorical_kl(post_logit, prior_logit.detach())
    loss = balance * to_prior.clamp(min=free_nats) + (1 - balance) * to_post.clamp(min=free_nats)
    return loss, to_prior.detach()
