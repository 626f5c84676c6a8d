"""DreamerV2 on what a frozen Grounding DINO makes of each frame: our reading, the paper gives no detail.

Owns the prompt, the layout of the vector, and how the detector is read. It is asked once a step, while
collecting; the replay keeps the vector.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from safetensors import SafetensorError
from torch import Tensor
from torch.nn import functional as F

from agent.config import AgentConfig, GroundingDinoConfig
from agent.envs.features import FeatureEnv
from agent.systems.dreamerv2 import assemble_vector, make_learner
from agent.systems.system import make_system
from langwm_data.config import ScenesConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.taxonomy import CATEGORIES, FOREIGN_CATEGORIES, UNKNOWN, is_nameable
from pretrain.mae import IMAGENET_MEAN, IMAGENET_STD

LONGEST_SHARE = 1333 / 800
"""The longer side is at most so many times ``short_side_px``. Source: Grounding DINO."""
FIRST_STRIDE = 8
"""Pixels between the places of the finest level; each further level has half as many places a side."""


def make_prompt(scenes: ScenesConfig) -> str:
    """Everything that may stand in the training floors, in words and full stops."""
    tables = {**CATEGORIES, **(FOREIGN_CATEGORIES if scenes.igibson else {})}
    names = [kind.phrase for name, kind in tables.items() if is_nameable(name) and name != UNKNOWN]
    return ". ".join(names).lower() + "."


class GroundingDino:
    """A frozen detector and a vector for each frame.

    The vector holds the mean of the encoder's visual states on each level, and then the mean and the maximum
    of the surest ``num_objects`` detections, each being its decoder state, box (middle, width, height, as
    shares) and score.

    Args:
        config: Which model, how large frames are shown to it, how many detections are pooled.
        prompt: What it looks for.
        device: Where it runs.

    Raises:
        ConfigError: If the model is out of reach, of another kind, or cannot read the whole prompt.
    """

    def __init__(self, config: GroundingDinoConfig, prompt: str, device: str = "cpu") -> None:
        self._config = config
        tokenizer, model = load_grounding_dino(config.model)
        words = tokenizer(prompt, return_tensors="pt")
        num_words, longest = words["input_ids"].shape[1], model.config.max_text_len
        if num_words > longest:
            raise ConfigError(
                f"grounding_dino.model {config.model!r} reads {longest} tokens but the categories of all"
                f" training floors are {num_words}"
            )
        self._words = {k: words[k].to(device) for k in ("input_ids", "token_type_ids", "attention_mask")}
        self._model = model.to(device).eval().requires_grad_(False)
        self._num_objects = min(config.num_objects, model.config.num_queries)
        width, levels = model.config.d_model, model.config.num_feature_levels
        self.feature_dim: int = levels * width + 2 * (width + 5)

    @torch.no_grad()
    def describe(self, rgb: UInt8[np.ndarray, "H W 3"]) -> Float32[np.ndarray, " V"]:
        """The vector of one frame."""
        seen = self._prepare(rgb)
        out = self._model(pixel_values=seen, **self._words)
        levels = _level_means(
            out.encoder_last_hidden_state_vision[0], seen.shape[-2:], self._model.config.num_feature_levels
        )
        score = out.logits[0].sigmoid().amax(-1)
        surest = score.topk(self._num_objects).indices
        found = torch.cat(
            [out.last_hidden_state[0][surest], out.pred_boxes[0][surest], score[surest, None]], -1
        )
        return torch.cat([levels.flatten(), found.mean(0), found.amax(0)]).float().cpu().numpy()

    def _prepare(self, rgb: UInt8[np.ndarray, "H W 3"]) -> Float[Tensor, "1 3 h w"]:
        """Enlarged and normalised as its pictures were in training."""
        short, long = sorted(rgb.shape[:2])
        scale = self._config.short_side_px * min(1.0, LONGEST_SHARE * short / long) / short
        size = [round(edge * scale) for edge in rgb.shape[:2]]
        pixels = torch.from_numpy(np.ascontiguousarray(rgb)).to(self._model.device)
        pixels = pixels.permute(2, 0, 1)[None].float() / 255
        pixels = F.interpolate(pixels, size, mode="bilinear", antialias=True)
        mean, std = (pixels.new_tensor(v)[:, None, None] for v in (IMAGENET_MEAN, IMAGENET_STD))
        return (pixels - mean) / std


def _level_means(
    states: Float[Tensor, "N D"], size: torch.Size, num_levels: int
) -> Float[Tensor, "levels D"]:
    """Means of each level's places, of which the states are one list.

    Raises:
        ConfigError: If the levels are others than Grounding DINO's.
    """
    strides = [FIRST_STRIDE * 2**level for level in range(num_levels)]
    counts = [math.prod(math.ceil(edge / stride) for edge in size) for stride in strides]
    if sum(counts) != len(states):
        raise ConfigError(
            f"grounding_dino.model has {len(states)} visual tokens for a frame of {size[0]} x {size[1]}"
            f" pixels; {sum(counts)} are known how to read, on {num_levels} levels of strides {strides}"
        )
    return torch.stack([level.mean(0) for level in states.split(counts)])


def load_grounding_dino(name: str) -> tuple[Any, Any]:
    """Tokenizer and detector by name or folder; no code of theirs is run.

    Raises:
        ConfigError: If it cannot be found or is no Grounding DINO.
    """
    from transformers import BertTokenizer, GroundingDinoConfig, GroundingDinoForObjectDetection
    from transformers.utils import logging

    logging.disable_progress_bar()
    logging.set_verbosity_error()
    try:
        held, _ = GroundingDinoConfig.get_config_dict(name)
        if "model_type" not in held:
            raise FileNotFoundError(name)
        if held["model_type"] != "grounding-dino":
            raise ConfigError(
                f"grounding_dino.model {name!r} is no Grounding DINO but of type {held['model_type']!r}"
            )
        tokenizer = BertTokenizer.from_pretrained(name)
        model = GroundingDinoForObjectDetection.from_pretrained(name, use_safetensors=True)
    except (OSError, RuntimeError, SafetensorError) as error:
        raise ConfigError(
            f"grounding_dino.model {name!r} cannot be loaded; give the name of a Grounding DINO that the"
            " Hugging Face hub or its local cache has, or a folder with config.json, model.safetensors and"
            " tokenizer"
        ) from error
    return tokenizer, model


@lru_cache(maxsize=1)
def _detector(config: GroundingDinoConfig, prompt: str, device: str) -> GroundingDino:
    """It never changes, so one serves every environment of a process."""
    return GroundingDino(config, prompt, device)


def wrap_env(config: AgentConfig, env: gymnasium.Env) -> FeatureEnv:
    """Add the vector to what ``env`` observes.

    Raises:
        ConfigError: If the detector is out of reach.
    """
    dino = _detector(config.grounding_dino, make_prompt(config.env.scenes), config.device)

    def describe(obs: Mapping[str, np.ndarray], info: Mapping[str, Any]) -> Float32[np.ndarray, " V"]:
        return dino.describe(obs["rgb"])

    return FeatureEnv(env, describe, dino.feature_dim)


SYSTEM = make_system(
    assemble_vector,
    make_learner,
    wrap_env=wrap_env,
    note="our reading: a frozen Grounding DINO pooled to one vector a step, which is told again; no pixels",
)
