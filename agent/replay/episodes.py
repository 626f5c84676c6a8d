"""What goes into the replay buffer and what comes out of it: episodes in, batches out. Data only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8, UInt16
from torch import Tensor

from pretrain.frames import FrameBatch, FrameObject


@dataclass(frozen=True, kw_only=True)
class ReplayEpisode:
    """One finished episode; step 0 is the reset. ``action[t]`` led to observation t and ``reward[t]``.

    What a system does not learn from is left out, and then costs no disk: all episodes of a buffer have
    the same entries.
    """

    rgb: UInt8[np.ndarray, "T H W 3"]
    task: Float32[np.ndarray, "T F"]
    action: Float32[np.ndarray, "T A"]
    reward: Float32[np.ndarray, " T"]
    is_terminal: bool
    """Whether the last step ended the episode for good; a timeout does not."""
    depth_mm: UInt16[np.ndarray, "T H W"] | None = None
    """Millimetres, 0 = invalid."""
    objects: Sequence[Sequence[FrameObject]] | None = None
    """Per step, the labelled objects."""
    features: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Float16 arrays (T, ...) by name: what was computed once a step because it is expensive."""


@dataclass(frozen=True, kw_only=True)
class ReplayBatch:
    """Chunks of episodes. A row may hold several episodes; ``is_first`` marks where each begins."""

    rgb: UInt8[Tensor, "B T H W 3"]
    task: Float[Tensor, "B T F"]
    action: Float[Tensor, "B T A"]
    """``action[:, t]`` led to observation t; zero at a reset."""
    reward: Float[Tensor, "B T"]
    """Received on arriving at observation t."""
    is_first: Bool[Tensor, "B T"]
    """True at a reset and in every row's first step: nothing before it belongs to the row."""
    is_last: Bool[Tensor, "B T"]
    is_terminal: Bool[Tensor, "B T"]
    """The last step of an episode that terminated; False where it was cut off by a timeout."""
    depth: Float[Tensor, "B T H W"] | None = None
    """Metres, 0 = invalid; None where depth is not stored."""
    objects: list[list[list[FrameObject]]] | None = None
    """Per row and step, the labelled objects: none where the environment gave none. None where they are
    not stored."""
    features: Mapping[str, Tensor] = field(default_factory=dict)
    """Float16, (B, T, ...), by name."""

    def to(self, device: torch.device | str) -> "ReplayBatch":
        """The same batch with its tensors on ``device``."""
        tensors = {k: v.to(device) for k, v in vars(self).items() if isinstance(v, Tensor)}
        return replace(self, **tensors, features={k: v.to(device) for k, v in self.features.items()})

    def frames(self) -> FrameBatch:
        """All steps of all rows as single frames, for finetuning the autoencoder.

        Where the buffer keeps no depth, it is zero: an autoencoder that fills in colours does not read it.
        Where it keeps no objects, there are none: what neither hides nor tells of them does not miss them.
        """
        shape = self.rgb.shape[:4]
        depth = torch.zeros(shape, device=self.rgb.device) if self.depth is None else self.depth
        objects = [held for row in self.objects or () for held in row]
        reward = self.reward.flatten().numpy(force=True)
        return FrameBatch(
            rgb=self.rgb.flatten(0, 1).numpy(force=True),
            depth=depth.flatten(0, 1).numpy(force=True),
            objects=objects or [[] for _ in reward],
            reward=reward,
            has_reward=np.ones(len(reward), dtype=np.bool_),
        )


@dataclass(frozen=True, kw_only=True)
class TransitionBatch:
    """Single steps with the frames around them: what one-step temporal differences are made of."""

    rgb: UInt8[Tensor, "B S H W 3"]
    """One frame more than a stack: all but the last are the observation, all but the first are the next
    observation. Before an episode's start its first frame is repeated."""
    task: Float[Tensor, "B 2 F"]
    """Of the observation and of the next one."""
    action: Float[Tensor, "B A"]
    """Led from the one to the other."""
    reward: Float[Tensor, " B"]
    is_terminal: Bool[Tensor, " B"]
    """Whether nothing comes after the next observation; False where time ran out."""

    def to(self, device: torch.device | str) -> "TransitionBatch":
        """The same batch on ``device``."""
        return TransitionBatch(**{name: tensor.to(device) for name, tensor in vars(self).items()})
