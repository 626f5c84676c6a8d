"""A vector of numbers that describes a frame, taken in and told again by perceptrons."""

import torch
from jaxtyping import Float
from torch import Tensor

from agent.config import WorldModelConfig
from agent.models.nets import make_mlp
from agent.models.observation import ObservationModel
from agent.models.world_model import half_square


class VectorModel(ObservationModel):
    """Vector and task observation side by side; the vector is told again from the state.

    Source: DreamerV2 (vector observations); method notes, section 5.
    """

    def __init__(self, config: WorldModelConfig, *, vector_dim: int, task_dim: int) -> None:
        super().__init__()
        sizes, task = config.vector, config.task
        self.encoder = make_mlp(vector_dim, sizes.units, sizes.layers)
        self.task_in = make_mlp(task_dim, task.units, task.layers)
        self.embed_dim = sizes.units + task.units
        self.decoder = make_mlp(config.rssm.feat_dim, sizes.units, sizes.layers, vector_dim)

    def embed(self, visual: Float[Tensor, "B V"], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """What the two perceptrons make of one step."""
        return torch.cat([self.encoder(visual), self.task_in(task)], -1)

    def losses(
        self, target: Float[Tensor, "B V"], embed: Float[Tensor, "B E"], feat: Float[Tensor, "B F"]
    ) -> dict[str, Float[Tensor, ""]]:
        """Negative log density of unit normals without its constant: summed over entries, mean of steps."""
        return {"vector": half_square(self.decoder(feat).float() - target).sum(-1).mean()}
