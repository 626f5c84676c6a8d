"""What the agent is told of its task, and the space of all observations."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from agent.config import EnvConfig
from agent.envs.actions import speed_limits
from langwm_data.sim.world import RobotState

XY = tuple[float, float]


def observation_space(config: EnvConfig) -> spaces.Space[Any]:
    """``rgb``, ``depth`` and ``task``."""
    size = (config.camera.height, config.camera.width)
    high = [np.inf, math.pi, *speed_limits(config)]
    low = [0.0, *(-limit for limit in high[1:])]
    if config.with_start_pose:
        high += [np.inf, np.inf, math.pi]
        low += [-np.inf, -np.inf, -math.pi]
    return spaces.Dict(
        {
            "rgb": spaces.Box(0, 255, (*size, 3), np.uint8),
            "depth": spaces.Box(0.0, config.camera.far_m, size, np.float32),
            "task": spaces.Box(np.array(low, np.float32), np.array(high, np.float32)),
        }
    )


def observe_task(state: RobotState, goal_xy: XY, start: tuple[XY, float] | None) -> np.ndarray:
    """The task entry: where the goal lies, how fast the robot is and, if asked for, where it stands.

    Args:
        state: Where the robot is and how it moved last.
        goal_xy: Metres, world frame.
        start: Where it began, and its yaw there; None leaves x, y and yaw out.

    Returns:
        Straight distance in metres, bearing in radians (left positive), m/s forwards, rad/s to the left; then
        metres ahead of and to the left of the start, radians turned to the left since.
    """
    (x, y), yaw = state.xy, state.yaw
    bearing = math.remainder(math.atan2(goal_xy[1] - y, goal_xy[0] - x) - yaw, 2 * math.pi)
    entries = [math.dist(state.xy, goal_xy), bearing, state.linear, state.angular]
    if start is not None:
        (start_x, start_y), start_yaw = start
        ahead, aside = math.cos(start_yaw), math.sin(start_yaw)
        off_x, off_y = x - start_x, y - start_y
        turned = math.remainder(yaw - start_yaw, 2 * math.pi)
        entries += [off_x * ahead + off_y * aside, off_y * ahead - off_x * aside, turned]
    return np.array(entries, dtype=np.float32)
