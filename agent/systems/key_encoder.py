"""A slowly moving copy of an autoencoder that is finetuned.

Two readings of the paper's "key encoder": the memory is given the copy's features, which drift less than
those of the MAE itself; or the copy sees a second view of each frame, which the state must find again.
"""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from pretrain.augment import augment_frame
from pretrain.average import WeightAverage
from pretrain.config import AugmentConfig
from pretrain.mae import LanguageGroundedMAE


class KeyEncoder(nn.Module):
    """The running mean of a MAE's weights; its own weights are saved with the agent's.

    Args:
        mae: What learns. The copy begins as it.
        momentum: Weight of the past in each step.
    """

    def __init__(self, mae: LanguageGroundedMAE, momentum: float) -> None:
        super().__init__()
        self._average = WeightAverage(mae, momentum)
        self.mae = self._average.model

    def follow(self, mae: LanguageGroundedMAE) -> None:
        """Take a step towards the weights of ``mae``."""
        self._average.follow(mae)

    def catch_up(self, mae: LanguageGroundedMAE) -> None:
        """Take over the weights of ``mae``."""
        self.mae.load_state_dict(mae.state_dict())

    def describe(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B V"]:
        """One vector for each frame: the mean of its tokens."""
        return self.mae.encode(rgb).mean(1)


def second_view(
    rng: np.random.Generator, rgb: UInt8[Tensor, "B T H W 3"], config: AugmentConfig
) -> UInt8[Tensor, "B T H W 3"]:
    """Every frame augmented on its own, as the MAE's input is."""
    frames = rgb.flatten(0, 1).numpy(force=True)
    nowhere = np.zeros(frames.shape[1:3], np.float32)
    seen = np.stack([augment_frame(rng, frame, nowhere, (), config)[0] for frame in frames])
    return torch.from_numpy(seen).to(rgb.device).unflatten(0, rgb.shape[:2])
