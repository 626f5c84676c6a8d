"""DreamerV2 that is told the simulator's own boxes: what a detector without fault would give it.

Owns the layout of the vector. Labels come from the environment, in training and whenever the agent acts.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Float32

from agent.config import AgentConfig
from agent.envs.features import FeatureEnv
from agent.envs.pointnav import PointNavEnv
from agent.systems.dreamerv2 import assemble_vector, make_learner
from agent.systems.system import make_system
from langwm_data.config_io import ConfigError
from langwm_data.scenes.taxonomy import CATEGORIES, FOREIGN_CATEGORIES
from pretrain.frames import FrameObject

KINDS: tuple[str, ...] = (*CATEGORIES, *FOREIGN_CATEGORIES)
"""Categories of objects, in the order of the taxonomy."""
NUM_PLACES = 6
"""Entries of an object before its kind: is there one, box, distance."""
FAR_M = 10.0
"""Distances are shares of this and end there. Source: method notes, decision 5."""


def describe_objects(
    objects: Sequence[FrameObject], num_objects: int, *, height: int, width: int
) -> Float32[np.ndarray, " V"]:
    """The nearest objects, nearest first, each in ``NUM_PLACES + len(KINDS)`` entries.

    0: 1, or 0 throughout where there is no such object. 1 to 4: left, top, right and bottom edge of its box
    as shares of width and height. 5: its distance as a share of ``FAR_M``. From 6: 1 at the number of its
    kind in ``KINDS``, else 0; 0 throughout for a kind that stands in no table.
    """
    held = np.zeros((num_objects, NUM_PLACES + len(KINDS)), np.float32)
    nearest = sorted(objects, key=lambda o: (o.distance_m, o.bbox_xyxy))
    for row, thing in zip(held, nearest, strict=False):
        row[0] = 1
        row[1:5] = np.array(thing.bbox_xyxy) / (width, height, width, height)
        row[5] = min(thing.distance_m / FAR_M, 1.0)
        if thing.category in KINDS:
            row[NUM_PLACES + KINDS.index(thing.category)] = 1
    return held.ravel()


def wrap_env(config: AgentConfig, env: gymnasium.Env) -> FeatureEnv:
    """Add the vector to what ``env`` observes.

    Raises:
        ConfigError: If ``env`` does not label objects: now, or for an environment that is not ours, at its
            first reset.
    """
    num_objects = config.oracle_boxes.num_objects
    if isinstance(env.unwrapped, PointNavEnv) and not env.unwrapped.config.with_labels:
        raise _refusal(config)

    def describe(obs: Mapping[str, np.ndarray], info: Mapping[str, Any]) -> Float32[np.ndarray, " V"]:
        if "objects" not in info:
            raise _refusal(config)
        height, width = obs["rgb"].shape[:2]
        return describe_objects(info["objects"], num_objects, height=height, width=width)

    return FeatureEnv(env, describe, num_objects * (NUM_PLACES + len(KINDS)))


def _refusal(config: AgentConfig) -> ConfigError:
    return ConfigError(
        f"system {config.system!r} needs info['objects'] at every step, which this environment does"
        " not give; set env.with_labels=true"
    )


SYSTEM = make_system(
    assemble_vector,
    make_learner,
    wrap_env=wrap_env,
    note="sees boxes, distances and categories from the simulator, no pixels: an upper bound of a detector"
    " and no fair row; not in the paper",
)
