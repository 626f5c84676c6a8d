"""How a world model takes in what is seen, and how it must tell it again."""

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn


class ObservationModel(nn.Module, ABC):
    """Encoder and decoder of one kind of visual input: image tokens, pixels, a vector.

    Everything in it is trained by the world model's loss.
    """

    embed_dim: int
    """Width of what the memory is given."""

    @abstractmethod
    def embed(self, visual: Float[Tensor, "B ..."], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """One vector for each step, from what is seen and the scaled task observation."""

    @abstractmethod
    def losses(
        self, target: Float[Tensor, "B ..."], embed: Float[Tensor, "B E"], feat: Float[Tensor, "B F"]
    ) -> dict[str, Float[Tensor, ""]]:
        """What embedding and state must tell about ``target``; the keys are fields of ``LossScales``."""
