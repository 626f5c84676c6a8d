"""What the entries of an action mean, and the motion that they ask for.

Every entry lies in [-1, 1] and is clipped to it. ``velocity``: forward and turning speed, an arc in a step.
``wheel``: speeds of the left and the right wheel, as iGibson 1.0 steers its TurtleBot. ``kinematic``: metres
forwards and radians to the left, turned first. Protocol ``habitat`` adds one entry, which stops: above
``config.stop_above`` the robot stays where it is and the episode is over.

Source: method notes, decision 23; ours (ADR-0018).
"""

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from agent.config import EnvConfig

_ENTRIES = {
    "velocity": ("v", "omega"),
    "wheel": ("left wheel", "right wheel"),
    "kinematic": ("forward", "turn"),
}


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What the robot is asked to do for one step."""

    linear_m_s: float
    angular_rad_s: float
    """Left positive."""
    turns_first: bool
    """Turn on the spot, then drive straight; else both at once."""
    is_stop: bool


def entry_names(config: EnvConfig) -> tuple[str, ...]:
    """What each entry of an action is called."""
    return (*_ENTRIES[config.action], *(("stop",) if config.protocol == "habitat" else ()))


def action_space(config: EnvConfig) -> spaces.Box:
    """All actions."""
    return spaces.Box(-1.0, 1.0, (len(entry_names(config)),), np.float32)


def speed_limits(config: EnvConfig) -> tuple[float, float]:
    """Greatest forward speed in m/s and turning speed in rad/s that an action can ask for."""
    if config.action == "velocity":
        return config.max_linear_m_s, config.max_angular_rad_s
    if config.action == "wheel":
        rim = config.wheels.max_rad_s * config.wheels.radius_m
        return rim, 2 * rim / config.wheels.axle_m
    return config.max_forward_m / config.step_s, config.max_turn_rad / config.step_s


def read_action(config: EnvConfig, action: np.ndarray) -> Motion:
    """The motion that an action asks for.

    Raises:
        ValueError: If it is not as many finite numbers as actions have entries.
    """
    names = entry_names(config)
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (len(names),) or not np.isfinite(values).all():
        raise ValueError(
            f"action {action!r} is not allowed; give {len(names)} finite numbers: {', '.join(names)}"
        )
    entries = [min(max(value, -1.0), 1.0) for value in values.tolist()]
    if len(names) == 3 and entries[2] > config.stop_above:
        return Motion(linear_m_s=0.0, angular_rad_s=0.0, turns_first=False, is_stop=True)
    linear, angular = entries[:2]
    if config.action == "wheel":
        linear, angular = 0.5 * (entries[0] + entries[1]), 0.5 * (entries[1] - entries[0])
    max_linear, max_angular = speed_limits(config)
    return Motion(
        linear_m_s=linear * max_linear,
        angular_rad_s=angular * max_angular,
        turns_first=config.action == "kinematic",
        is_stop=False,
    )


def make_action(
    config: EnvConfig, *, linear_m_s: float = 0.0, angular_rad_s: float = 0.0, is_stop: bool = False
) -> np.ndarray:
    """The action that asks for these speeds, or as nearly as there is one.

    What wheels cannot do at once is slowed down, forwards and turning alike, so that the arc stays the same.
    """
    max_linear, max_angular = speed_limits(config)
    first, second = linear_m_s / max_linear, angular_rad_s / max_angular
    if config.action == "wheel":
        first, second = first - second, first + second
        most = max(abs(first), abs(second), 1.0)
        first, second = first / most, second / most
    entries = [first, second, *([1.0 if is_stop else -1.0] if config.protocol == "habitat" else [])]
    return np.clip(entries, -1.0, 1.0).astype(np.float32)
