"""How far imagined returns spread, so that the actor's entropy weighs the same whatever rewards are."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

RATE = 0.01
"""Weight of the newest batch in the running mean. Source: DreamerV3."""
PERCENTILES = (0.05, 0.95)
FLOOR = 1.0
"""Small returns, as where nothing has been found yet, are not blown up. Source: DreamerV3."""


class ReturnScale(nn.Module):
    """A running mean of the distance between the 5th and the 95th percentile, at least 1."""

    spread: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("spread", torch.zeros(()))

    @torch.no_grad()
    def follow(self, returns: Float[Tensor, "B T"]) -> Float[Tensor, ""]:
        """Take a step towards these returns; what to divide them by."""
        values = returns.float().flatten()
        low, high = torch.quantile(values, values.new_tensor(PERCENTILES))
        self.spread.lerp_(high - low, RATE)
        return self.spread.clamp(min=FLOOR)
