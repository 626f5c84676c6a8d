"""From image tokens and task observation to one vector per step, and back.

Owns the pooling transformer autoencoder and the encoder of the task observation. The image tokens come
from the MAE and are never changed here.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.config import PoolingConfig, TaskConfig, WorldModelConfig
from agent.models.nets import make_linear, make_mlp
from agent.models.observation import ObservationModel
from pretrain.parts import map_parts, mean_loss
from pretrain.transformer import Transformer


class TokenModel(ObservationModel):
    """Tokens pooled into one vector, and told again from that vector and from the state.

    Source: Table 3; method notes, decision 16.
    """

    def __init__(self, config: WorldModelConfig, *, num_tokens: int, token_dim: int, task_dim: int) -> None:
        super().__init__()
        self.encoder = PoolingEncoder(config.pooling, config.task, token_dim, task_dim)
        self.embed_dim = self.encoder.embed_dim
        self._tells_embedding = config.loss_scales.pool > 0
        self.decoder = TokenDecoder(
            config.pooling,
            num_tokens=num_tokens,
            visual_dim=token_dim,
            embed_dim=self.embed_dim,
            feat_dim=config.rssm.feat_dim,
        )

    def embed(self, visual: Float[Tensor, "B N V"], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """Pool the tokens of a frame and the task token."""
        return map_parts(self.encoder, visual, task)

    def losses(
        self, target: Float[Tensor, "B N V"], embed: Float[Tensor, "B E"], feat: Float[Tensor, "B F"]
    ) -> dict[str, Float[Tensor, ""]]:
        """Squared errors of the tokens, summed over channels and averaged over tokens, as MWM's are.

        From the embedding only where that counts: it takes as long as all else in the world model.
        """
        losses = {"token": self._error(self.decoder.from_state(feat), target)}
        if self._tells_embedding:
            losses["pool"] = self._error(self.decoder.from_embed(embed), target)
        return losses

    def _error(self, vector: Float[Tensor, "B D"], target: Float[Tensor, "B N V"]) -> Float[Tensor, ""]:
        def error(vector: Tensor, target: Tensor) -> Tensor:
            return (self.decoder(vector) - target).square().sum(-1).mean(-1)

        return mean_loss(self.decoder, error, vector, target)


class PoolingEncoder(nn.Module):
    """Transformer over all visual tokens and one task token; its embedding is their mean.

    With ``task.skips_pooling`` the task token stands beside the mean as well.

    Source: Table 3 (81 + 1 tokens, 2 layers, 4 heads); Sec. 3.2 (task observation: 4 x 256, ELU);
    ours (ADR-0009: the task token past the mean).
    """

    def __init__(self, config: PoolingConfig, task: TaskConfig, visual_dim: int, task_dim: int) -> None:
        super().__init__()
        self.visual_in = make_linear(visual_dim, config.dim)
        self.task_in = make_mlp(task_dim, task.units, task.layers, config.dim)
        self.transformer = make_transformer(config)
        self._skips_pooling = task.skips_pooling
        self.embed_dim = config.dim * (2 if task.skips_pooling else 1)

    def forward(self, visual: Float[Tensor, "B N V"], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """The average token, and the task token where it skips the pooling."""
        task_token = self.task_in(task)
        tokens = torch.cat([self.visual_in(visual), task_token[:, None]], dim=1)
        average = self.transformer(tokens).mean(1)
        return torch.cat([average, task_token], -1) if self._skips_pooling else average


class TokenDecoder(nn.Module):
    """Transformer from one vector and mask tokens to the image tokens.

    The vector is the encoder's embedding or the state of the world model: each has a projection of
    its own, the rest is shared.

    Source: Table 3 (2 layers, decoder input avg(tokens)); MWM (decoding from the state).
    """

    def __init__(
        self, config: PoolingConfig, *, num_tokens: int, visual_dim: int, embed_dim: int, feat_dim: int
    ) -> None:
        super().__init__()
        self.from_embed = make_linear(embed_dim, config.dim)
        self.from_state = make_linear(feat_dim, config.dim)
        self.mask_token = nn.Parameter(0.02 * torch.randn(config.dim))
        self.pos_embed = nn.Parameter(0.02 * torch.randn(num_tokens, config.dim))
        self.transformer = make_transformer(config)
        self.out = make_linear(config.dim, visual_dim)

    def forward(self, vector: Float[Tensor, "B D"]) -> Float[Tensor, "B N V"]:
        """Image tokens, decoded from a vector that one of the two projections has made."""
        masked = (self.mask_token + self.pos_embed).expand(len(vector), -1, -1)
        tokens = self.transformer(torch.cat([vector[:, None], masked], dim=1))
        return self.out(tokens[:, 1:])


def make_transformer(config: PoolingConfig) -> Transformer:
    """The layers of the encoder or of the decoder."""
    return Transformer(
        config.dim,
        config.num_layers,
        config.num_heads,
        mlp_ratio=config.mlp_ratio,
        dropout=config.dropout,
        eps=config.norm_eps,
    )
