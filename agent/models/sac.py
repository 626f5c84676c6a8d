"""Networks and losses of the soft actor-critic that CURL and RAD share. Owns no optimizer.

Source: the public code of CURL and RAD.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from agent.config import SACConfig
from pretrain.parts import map_parts

LOG_STD = (-10.0, 2.0)
"""Limits of the policy's log standard deviation."""
STRIDES = (2, 1, 1, 1)
KERNEL = 3


def encoded_size(height: int, width: int) -> tuple[int, int]:
    """Height and width of what the convolutions leave of an image; below 1 where it is too small."""
    for stride in STRIDES:
        height, width = ((edge - KERNEL) // stride + 1 for edge in (height, width))
    return height, width


@dataclass(frozen=True)
class TanhGaussian:
    """Independent normals squashed by tanh, one per action dimension."""

    mean: Float[Tensor, "B A"]
    log_std: Float[Tensor, "B A"]

    @property
    def mode(self) -> Float[Tensor, "B A"]:
        """The squashed mean: how the policy acts when it does not explore."""
        return self.mean.tanh()

    def rsample(self, generator: torch.Generator) -> tuple[Float[Tensor, "B A"], Float[Tensor, " B"]]:
        """Differentiable actions and their log densities."""
        noise = torch.randn(self.mean.shape, generator=generator, device=self.mean.device)
        raw = self.mean + self.log_std.exp() * noise
        log_normal = -0.5 * noise**2 - self.log_std - 0.5 * math.log(2 * math.pi)
        log_slope = 2 * (math.log(2) - raw - F.softplus(-2 * raw))
        return raw.tanh(), (log_normal - log_slope).sum(-1)


class PixelEncoder(nn.Module):
    """Four convolutions and a layer-normalised projection.

    Args:
        config: Filters, width of the output, frames of a stack.
        size: Height and width of what it sees, pixels.
    """

    def __init__(self, config: SACConfig, size: tuple[int, int]) -> None:
        super().__init__()
        channels, layers = 3 * config.frame_stack, []
        for stride in STRIDES:
            layers += [_make_conv(channels, config.filters, stride), nn.ReLU()]
            channels = config.filters
        self.convs = nn.Sequential(*layers, nn.Flatten())
        self.projection = make_projection(config, size)

    def convolve(self, pixels: Float[Tensor, "B S 3 h w"]) -> Float[Tensor, "B N"]:
        """What actor and critic share."""
        return map_parts(self.convs, pixels.flatten(1, 2))

    def forward(self, pixels: Float[Tensor, "B S 3 h w"]) -> Float[Tensor, "B D"]:
        """The critic's feature."""
        return self.projection(self.convolve(pixels))


class Critic(nn.Module):
    """Two values of an action. It owns the convolutions, which the actor reads but does not train."""

    def __init__(self, config: SACConfig, size: tuple[int, int], task_dim: int, action_dim: int) -> None:
        super().__init__()
        self.encoder = PixelEncoder(config, size)
        width = config.feature_dim + task_dim + action_dim
        self.values = nn.ModuleList(_make_mlp(width, config.hidden, 1) for _ in range(2))

    def forward(
        self, convolved: Float[Tensor, "B N"], task: Float[Tensor, "B F"], action: Float[Tensor, "B A"]
    ) -> Float[Tensor, "B 2"]:
        """Expected discounted rewards after ``action``."""
        x = torch.cat([self.encoder.projection(convolved), task, action], -1)
        return torch.cat([value(x) for value in self.values], -1).float()


class Actor(nn.Module):
    """The policy, on the critic's convolutions and a projection of its own."""

    def __init__(self, config: SACConfig, size: tuple[int, int], task_dim: int, action_dim: int) -> None:
        super().__init__()
        self.projection = make_projection(config, size)
        self.mlp = _make_mlp(config.feature_dim + task_dim, config.hidden, 2 * action_dim)

    def forward(self, convolved: Float[Tensor, "B N"], task: Float[Tensor, "B F"]) -> TanhGaussian:
        """Distribution of the next action. No gradient goes back into the convolutions."""
        x = torch.cat([self.projection(convolved.detach()), task], -1)
        mean, raw = self.mlp(x).float().chunk(2, -1)
        low, high = LOG_STD
        return TanhGaussian(mean, low + 0.5 * (high - low) * (raw.tanh() + 1))


@dataclass(frozen=True, kw_only=True)
class Transitions:
    """One batch as the losses read it."""

    pixels: Float[Tensor, "B S 3 h w"]
    next_pixels: Float[Tensor, "B S 3 h w"]
    task: Float[Tensor, "B F"]
    """Scaled."""
    next_task: Float[Tensor, "B F"]
    action: Float[Tensor, "B A"]
    reward: Float[Tensor, " B"]
    is_terminal: Bool[Tensor, " B"]


def target_value(
    reward: Float[Tensor, " B"],
    is_terminal: Bool[Tensor, " B"],
    next_values: Float[Tensor, "B 2"],
    next_log_prob: Float[Tensor, " B"],
    alpha: Float[Tensor, ""],
    discount: float,
) -> Float[Tensor, " B"]:
    """What the critics should say: the smaller of two next values, plus entropy, where there is a next."""
    soft = next_values.min(-1).values - alpha * next_log_prob
    return reward + discount * (~is_terminal).float() * soft


def critic_loss(values: Float[Tensor, "B 2"], target: Float[Tensor, " B"]) -> Float[Tensor, ""]:
    """Squared errors of both critics, added."""
    return (values - target[:, None]).square().mean(0).sum()


def actor_loss(
    values: Float[Tensor, "B 2"], log_prob: Float[Tensor, " B"], alpha: Float[Tensor, ""]
) -> Float[Tensor, ""]:
    """Prefer what the more doubtful critic likes, and many actions over few."""
    return (alpha.detach() * log_prob - values.min(-1).values).mean()


def alpha_loss(
    log_alpha: Float[Tensor, ""], log_prob: Float[Tensor, " B"], action_dim: int
) -> Float[Tensor, ""]:
    """Raises alpha while the entropy is below minus the number of actions, else lowers it."""
    return (log_alpha.exp() * (-log_prob.detach() + action_dim)).mean()


def contrastive_loss(
    anchor: Float[Tensor, "B D"], positive: Float[Tensor, "B D"], bilinear: Float[Tensor, "D D"]
) -> Float[Tensor, ""]:
    """InfoNCE: each anchor must find its positive among those of the batch.

    Source: CURL, bilinear similarity.
    """
    logits = (anchor @ bilinear @ positive.T).float()
    logits = logits - logits.max(1, keepdim=True).values
    return F.cross_entropy(logits, torch.arange(len(logits), device=logits.device))


def move_towards(target: nn.Module, source: nn.Module, tau: float) -> None:
    """Move every weight of ``target`` by the share ``tau`` of its distance from ``source``."""
    with torch.no_grad():
        for slow, fast in zip(target.parameters(), source.parameters(), strict=True):
            slow.lerp_(fast, tau)


def make_projection(config: SACConfig, size: tuple[int, int]) -> nn.Sequential:
    """From the convolutions' output to a normalised feature."""
    height, width = encoded_size(*size)
    linear = _make_linear(config.filters * height * width, config.feature_dim)
    return nn.Sequential(linear, nn.LayerNorm(config.feature_dim))


def _make_mlp(in_features: int, hidden: int, out_features: int) -> nn.Sequential:
    return nn.Sequential(
        _make_linear(in_features, hidden),
        nn.ReLU(),
        _make_linear(hidden, hidden),
        nn.ReLU(),
        _make_linear(hidden, out_features),
    )


def _make_linear(in_features: int, out_features: int) -> nn.Linear:
    linear = nn.Linear(in_features, out_features)
    nn.init.orthogonal_(linear.weight)
    nn.init.zeros_(linear.bias)
    return linear


def _make_conv(in_channels: int, out_channels: int, stride: int) -> nn.Conv2d:
    """Orthogonal in the middle of the kernel, zero around it. Source: arXiv 1806.05393."""
    conv = nn.Conv2d(in_channels, out_channels, KERNEL, stride)
    for weight in conv.parameters():
        nn.init.zeros_(weight)
    nn.init.orthogonal_(conv.weight[:, :, KERNEL // 2, KERNEL // 2], gain=nn.init.calculate_gain("relu"))
    return conv
