"""Frames as numbers around 0, and the convolutions that take them in and tell them again."""

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from agent.config import WorldModelConfig
from agent.models.nets import make_linear, make_mlp
from agent.models.observation import ObservationModel
from agent.models.world_model import half_square
from pretrain.parts import map_parts, mean_loss

NUM_LAYERS = 4
STRIDE = 2**NUM_LAYERS
"""Frames must be multiples of this, in pixels: every convolution halves them."""


def as_pixels(rgb: UInt8[Tensor, "*B H W 3"]) -> Float[Tensor, "*B 3 H W"]:
    """Numbers from -0.5 to 0.5; the channels of a pixel stay side by side in memory. Source: DreamerV2."""
    return rgb.movedim(-1, -3).float().div(255).sub(0.5)


def as_rgb(pixels: Float[Tensor, "*B 3 H W"]) -> UInt8[Tensor, "*B H W 3"]:
    """Inverse of ``as_pixels``; what lies beyond black and white is clipped."""
    levels = pixels.float().add(0.5).mul(255).round().clamp(0, 255)
    return levels.to(torch.uint8).movedim(-3, -1)


class PixelModel(ObservationModel):
    """Frame and task observation side by side; the frame is told again from the state.

    Args:
        config: Sizes.
        height: Of the frames, a multiple of ``STRIDE`` pixels.
        width: Likewise.
        task_dim: Entries of the task observation.

    Source: DreamerV2; method notes, section 2 (SAME convolutions and mirrored deconvolutions).
    """

    def __init__(self, config: WorldModelConfig, *, height: int, width: int, task_dim: int) -> None:
        super().__init__()
        self._grid = (height // STRIDE, width // STRIDE)
        widths = [config.pixels.channels * 2**layer for layer in range(NUM_LAYERS)]
        self.encoder = _make_encoder(widths)
        self.task_in = make_mlp(task_dim, config.task.units, config.task.layers)
        num_features = widths[-1] * self._grid[0] * self._grid[1]
        self.embed_dim = num_features + config.task.units
        self.decoder_in = make_linear(config.rssm.feat_dim, num_features)
        self.decoder = _make_decoder(widths[::-1])

    def embed(self, visual: Float[Tensor, "B 3 H W"], task: Float[Tensor, "B P"]) -> Float[Tensor, "B E"]:
        """What the convolutions and the perceptron of the task observation make of one step."""
        seen = map_parts(lambda part: self.encoder(part).movedim(1, -1).flatten(1), visual)
        return torch.cat([seen, self.task_in(task)], -1)

    def decode(self, feat: Float[Tensor, "B F"]) -> Float[Tensor, "B 3 H W"]:
        """The frame of a state: the mean of a Gaussian of unit scale for each number."""
        return self._draw(self.decoder_in(feat))

    def _draw(self, features: Float[Tensor, "B N"]) -> Float[Tensor, "B 3 H W"]:
        grid = features.unflatten(-1, (*self._grid, -1))
        return self.decoder(grid.movedim(-1, 1)).float()

    def losses(
        self, target: Float[Tensor, "B 3 H W"], embed: Float[Tensor, "B E"], feat: Float[Tensor, "B F"]
    ) -> dict[str, Float[Tensor, ""]]:
        """Negative log density without its constant: summed over pixels and colours, averaged over steps.

        A frame of one gray more or less than it should be, by a tenth of black to white, costs 307 at
        128x160 and 77 at 64x80. Source: DreamerV2.
        """

        def error(features: Tensor, target: Tensor) -> Tensor:
            return half_square(self._draw(features) - target).sum((1, 2, 3))

        return {"image": mean_loss(self.decoder, error, self.decoder_in(feat), target)}


def _make_encoder(widths: list[int]) -> nn.Sequential:
    modules: list[nn.Module] = []
    for before, after in zip([3, *widths], widths, strict=False):
        modules += [_init(nn.Conv2d(before, after, 4, 2, padding=1)), nn.ELU()]
    return nn.Sequential(*modules)


def _make_decoder(widths: list[int]) -> nn.Sequential:
    modules: list[nn.Module] = []
    for before, after in zip(widths, [*widths[1:], 3], strict=True):
        modules += [nn.ELU(), _init(nn.ConvTranspose2d(before, after, 4, 2, padding=1))]
    return nn.Sequential(*modules[1:])


def _init(layer: nn.Conv2d | nn.ConvTranspose2d) -> nn.Module:
    nn.init.xavier_uniform_(layer.weight)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer
