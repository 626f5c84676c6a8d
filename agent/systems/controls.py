"""Policies that learn nothing: what every learned one has to beat."""

import math
from collections.abc import Callable, Mapping
from typing import cast

import gymnasium
import numpy as np

from agent.config import EnvConfig
from agent.envs.actions import entry_names, make_action, speed_limits
from agent.envs.pointnav import PointNavEnv
from agent.envs.protocols import success_radius
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


def make_straight_ahead(config: EnvConfig) -> Policy:
    """Full speed forwards, whatever comes."""
    action = make_action(config, linear_m_s=speed_limits(config)[0])

    def act(obs: Mapping[str, np.ndarray], state: None) -> tuple[np.ndarray, None]:
        return action, None

    return act


def make_turn_to_goal(config: EnvConfig) -> Policy:
    """Turn until the goal is ahead, then drive towards it; blind to obstacles.

    Where an agent has to stop by itself, it stops as near as success asks for.
    """
    (linear, angular), (_, radius_m) = speed_limits(config), success_radius(config)

    def act(obs: Mapping[str, np.ndarray], state: None) -> tuple[np.ndarray, None]:
        distance, bearing = obs["task"][:2].tolist()
        speed = 0.0 if abs(bearing) > TURN_ABOVE_RAD else linear
        turn = angular * min(max(bearing / TURN_ABOVE_RAD, -1.0), 1.0)
        return make_action(config, linear_m_s=speed, angular_rad_s=turn, is_stop=distance < radius_m), None

    return act


CONTROLS: Mapping[str, Callable[[EnvConfig], Policy]] = {
    "random": lambda config: make_random_policy(0, len(entry_names(config))),
    "straight-ahead": make_straight_ahead,
    "turn-to-goal": make_turn_to_goal,
}
"""Controls that see what an agent sees, by their names in tables, for the actions of a config."""
ORACLE = "oracle"
CONTROL_NAMES = (*CONTROLS, ORACLE)
"""All controls, the one that is told the way included."""


def make_control(name: str, env: gymnasium.Env) -> Policy:
    """The control of that name, to be played in ``env`` alone, a ``PointNavEnv`` or a wrapper around it.

    Raises:
        ConfigError: If there is no such control.
    """
    if name == ORACLE:
        return make_oracle(env)
    if name not in CONTROLS:
        raise ConfigError(f"control {name!r} is unknown; allowed: {', '.join(CONTROL_NAMES)}")
    return CONTROLS[name](cast("PointNavEnv", env.unwrapped).config)
