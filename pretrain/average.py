"""A running mean of weights, which follows the model that learns and is often a little better than it."""

import copy
from typing import Any

import torch

from pretrain.mae import LanguageGroundedMAE


class WeightAverage:
    """The exponential mean of a model's weights.

    Args:
        model: What learns.
        decay: Weight of the past in each step; 0 follows at once and costs nothing: ``model`` itself.
    """

    def __init__(self, model: LanguageGroundedMAE, decay: float) -> None:
        self._decay = decay
        self.model = model if decay == 0 else copy.deepcopy(model).requires_grad_(False)
        """The model with the mean weights."""

    @torch.no_grad()
    def follow(self, model: LanguageGroundedMAE) -> None:
        """Take a step towards the weights of ``model``."""
        if self.model is model:
            return
        for mean, weight in zip(self.model.parameters(), model.parameters(), strict=True):
            mean.lerp_(weight, 1 - self._decay)

    def state_dict(self) -> dict[str, Any]:
        """The mean weights, where they are not those of the model itself."""
        return self.model.state_dict() if self._decay else {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        if self._decay:
            self.model.load_state_dict(state)
