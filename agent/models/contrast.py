"""States told apart by another encoder's view of the same frames."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from agent.models.nets import make_linear

TEMPERATURE = 0.1
"""Of the cosines. Source: SimCLR."""


class Contrast(nn.Module):
    """InfoNCE: of all frames of a batch, a state must find its own.

    Source: ours, after what is left of it in the paper (Table 3, key encoder); method notes, section 1 (c).
    """

    def __init__(self, feat_dim: int, key_dim: int) -> None:
        super().__init__()
        self.query = make_linear(feat_dim, key_dim)

    def loss(self, feat: Float[Tensor, "B F"], key: Float[Tensor, "B V"]) -> Float[Tensor, ""]:
        """Cross-entropy in nats; the logarithm of B where nothing is known. ``key`` learns nothing."""
        query = F.normalize(self.query(feat).float(), dim=-1)
        similarity = query @ F.normalize(key.detach().float(), dim=-1).T
        own = torch.arange(len(feat), device=feat.device)
        return F.cross_entropy(similarity.float() / TEMPERATURE, own)
