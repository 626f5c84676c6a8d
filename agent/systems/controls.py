"""Policies that learn nothing: what every learned one has to beat."""

import math
from collections.abc import Mapping

import gymnasium
import numpy as np

from agent.rollout import Policy
from agent.systems.oracle import make_oracle
from langwm_data.config_io import ConfigError
from langwm_data.seeding import make_rng

TURN_ABOVE_RAD = math.radians(15)
"""Beyond this bearing, ``turn_to_goal`` turns on the spot."""


def make_random_policy(seed: int, action_dim: int = 2) -> Policy:
    """Uniform actions, drawn from the seed, the step and the task observation.

    So they differ between episodes, and playing an episode again repeats them.
    """

    def act(obs: Mapping[str, np.ndarray], state: int | None) -> tuple[np.ndarray, int]:
        step = state or 0
        rng = make_rng(seed, "random policy", step, obs["task"].tobytes().hex())
        return rng.uniform(-1, 1, size=action_dim).astype(np.float32), step + 1

    return act


def straight_ahead(obs: Mapping[str, np.ndarray], state: None) -> tuple[np.ndarray, None]:
    """Full speed forwards, whatever comes."""
    return np.array([1, 0], dtype=np.float32), None


def turn_to_goal(obs: Mapping[str, np.ndarray], state: None) -> tuple[np.ndarray, None]:
    """Turn until the goal is ahead, then drive towards it; blind to obstacles."""
    bearing = float(obs["task"][1])
    turn = float(np.clip(bearing / TURN_ABOVE_RAD, -1, 1))
    return np.array([0 if abs(bearing) > TURN_ABOVE_RAD else 1, turn], dtype=np.float32), None


CONTROLS: Mapping[str, Policy] = {
    "random": make_random_policy(0),
    "straight-ahead": straight_ahead,
    "turn-to-goal": turn_to_goal,
}
"""Controls that see what an agent sees, under the names they have in tables."""
ORACLE = "oracle"
CONTROL_NAMES = (*CONTROLS, ORACLE)
"""All controls, the one that is told the way included."""


def make_control(name: str, env: gymnasium.Env) -> Policy:
    """The control of that name, to be played in ``env`` alone.

    Raises:
        ConfigError: If there is no such control.
    """
    if name == ORACLE:
        return make_oracle(env)
    if name not in CONTROLS:
        raise ConfigError(f"control {name!r} is unknown; allowed: {', '.join(CONTROL_NAMES)}")
    return CONTROLS[name]
