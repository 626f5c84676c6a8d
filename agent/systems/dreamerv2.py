"""DreamerV2: the same memory and behaviour on pixels or on a vector that describes a frame.

Owns what the four systems of this name share and the two that learn from pixels. What frames are described
by otherwise stands in ``grounding_dino`` and ``oracle_boxes``.
"""

from collections.abc import Mapping
from typing import cast

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from agent.config import AgentConfig
from agent.models.pixels import STRIDE, PixelModel, as_pixels, as_rgb
from agent.models.vector import VectorModel
from agent.systems.dreamer import Dreamer, Perception, make_dreamer
from agent.systems.learner import DreamerLearner
from agent.systems.system import Model, Spaces, make_system
from langwm_data.config_io import ConfigError
from pretrain.augment import augment_frame
from pretrain.config import AugmentConfig


def make_learner(model: Model, config: AgentConfig) -> DreamerLearner:
    """What all four learn by."""
    return DreamerLearner(cast("Dreamer", model), config)


class PixelPerception(Perception):
    """The frame itself.

    Args:
        augment: What the encoder's frames are changed by while it learns; None leaves them alone.
    """

    def __init__(self, augment: AugmentConfig | None = None) -> None:
        super().__init__()
        self._augment = augment

    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B 3 H W"]:
        """Pixels of ``rgb``."""
        return as_pixels(obs["rgb"])

    def augment(
        self, visual: Float[Tensor, "B T 3 H W"], generator: torch.Generator
    ) -> Float[Tensor, "B T 3 H W"]:
        """Every sequence changed by one draw, all of its frames alike.

        When the agent acts, colours and camera stay what they are from step to step. A draw for each
        frame would be noise that the memory averages out, and would hide how far a turn moves the picture.
        """
        if self._augment is None:
            return visual
        seeds = torch.randint(2**31, (len(visual),), generator=generator, device=visual.device).tolist()
        frames = as_rgb(visual).numpy(force=True)
        seen = [_augment_alike(rows, seed, self._augment) for rows, seed in zip(frames, seeds, strict=True)]
        return as_pixels(torch.from_numpy(np.stack(seen)).to(visual.device))


def _augment_alike(
    frames: UInt8[np.ndarray, "T H W 3"], seed: int, config: AugmentConfig
) -> UInt8[np.ndarray, "T H W 3"]:
    nowhere = np.zeros(frames.shape[1:3], np.float32)
    changed = [augment_frame(np.random.default_rng(seed), frame, nowhere, (), config) for frame in frames]
    return np.stack([rgb for rgb, _, _ in changed])


def _assemble_pixels(config: AgentConfig, spaces: Spaces) -> Dreamer:
    height, width, sizes = spaces.height, spaces.width, config.world_model
    if height % STRIDE or width % STRIDE:
        raise ConfigError(
            f"env.camera is {height} x {width} pixels but system {config.system!r} needs multiples of"
            f" {STRIDE}: each of its convolutions halves the frame"
        )
    perception = PixelPerception(config.finetune.augment if sizes.pixels.is_augmented else None)
    observation = PixelModel(sizes, height=height, width=width, task_dim=spaces.task_dim)
    return make_dreamer(perception, observation, config, spaces)


class FeaturePerception(Perception):
    """The vector that ``System.wrap_env`` has added to the observation."""

    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B V"]:
        """The entry ``features``."""
        return obs["features"].float()


def assemble_vector(config: AgentConfig, spaces: Spaces) -> Dreamer:
    """A dreamer that sees the entry ``features`` alone, beside the task observation."""
    observation = VectorModel(config.world_model, vector_dim=spaces.feature_dim, task_dim=spaces.task_dim)
    return make_dreamer(FeaturePerception(), observation, config, spaces)


DREAMERV2 = make_system(
    _assemble_pixels,
    make_learner,
    note="tells RGB again; heads, memory and behaviour as in langwm; no pretraining",
)
DREAMERV2_DA = make_system(
    _assemble_pixels,
    make_learner,
    note="as dreamerv2; the encoder sees langwm's augmentations, the same for all frames of a sequence,"
    " and tells the unchanged frames again",
)
