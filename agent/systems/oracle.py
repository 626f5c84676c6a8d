"""A control that is told the way: it follows the geodesic field of the environment to the goal.

What it reaches is what the task allows: an upper bound for every system that has only its camera.
"""

import math
from collections.abc import Mapping

import gymnasium
import numpy as np
from jaxtyping import Float64
from numpy.typing import NDArray

from agent.envs.actions import make_action, speed_limits
from agent.envs.pointnav import PointNavEnv
from agent.envs.protocols import success_radius
from agent.rollout import Policy
from langwm_data.scenes.navigation import FreeSpace

LOOK_AHEAD_M = 1.5
"""It aims at the farthest point of the way within this distance that it can drive to straight."""
NEAREST_M = 0.06
"""It has come to a point that is nearer: a step on, it would have to turn back to it."""
BESIDE_M = 0.03
"""So far beside a straight drive there must be room as well: a free cell is free at its middle only."""
SAMPLE_M = 0.02
"""Distance of the points at which a straight drive is looked at."""
STOP_SHARE = 0.9
"""It stops, where it has to, within this share of the distance that counts."""
TURN_ABOVE_RAD = math.radians(20)
"""Beyond this bearing it turns on the spot."""

Target = Float64[np.ndarray, " 2"]
"""The point that it drives to, which is what it remembers."""


def make_oracle(env: gymnasium.Env) -> Policy:
    """A policy for ``env`` alone, which it looks into at every step; its actions are those of ``env``.

    Args:
        env: ``PointNavEnv`` or a wrapper around it.

    Raises:
        ValueError: If it is another environment, which knows no ways.
    """
    world = env.unwrapped
    if not isinstance(world, PointNavEnv):
        raise ValueError(
            f"the oracle needs PointNavEnv, which knows the way; {type(world).__name__} does not"
        )

    config = world.config

    def act(obs: Mapping[str, np.ndarray], state: Target | None) -> tuple[np.ndarray, Target]:
        place = np.array(world.robot.xy)
        target = state
        # Once aimed at, a point is driven to: beside a narrow sight the shortest way leads back into it.
        if target is None or world.robot.is_collision or math.dist(target, place) < NEAREST_M:
            target = _aim(world, place)
        towards = math.atan2(*(target - place)[::-1])
        bearing = math.remainder(towards - world.robot.yaw, 2 * math.pi)
        speed = 0.0 if abs(bearing) > TURN_ABOVE_RAD else speed_limits(config)[0]
        turn = bearing / config.step_s
        is_there = world.field.distance(place) < STOP_SHARE * success_radius(config)[1]
        return make_action(config, linear_m_s=speed, angular_rad_s=turn, is_stop=is_there), target

    return act


def _aim(world: PointNavEnv, place: Float64[np.ndarray, " 2"]) -> Float64[np.ndarray, " 2"]:
    """The farthest point of the shortest way that can be driven to straight from ``place``."""
    try:
        way = world.field.path(place)
    except ValueError:  # squeezed in where no free cell is near
        return np.array(world.episode.goal_xy)
    far = [corner for corner in way[1:] if math.dist(corner, place) >= NEAREST_M] or [way[-1]]
    best = far[0]
    for corner in far[1:]:
        if math.dist(corner, place) > LOOK_AHEAD_M or not _is_clear(world.field.space, place, corner):
            break
        best = corner
    return best


def _is_clear(space: FreeSpace, start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
    """Whether the cells along a straight line and beside it are free, the one it begins in left out."""
    along = end - start
    beside = BESIDE_M * np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    count = max(2, math.ceil(math.dist(start, end) / SAMPLE_M))
    middle = start + np.linspace(0, 1, count + 1)[1:, None] * along
    points = np.concatenate([middle, middle + beside, middle - beside])
    cells = np.floor((points - space.origin) / space.resolution_m).astype(int)
    cells = cells[(cells != space.cell(start)).any(axis=1)]
    is_inside = (cells >= 0).all() and (cells < space.grid.shape).all()
    return bool(is_inside and space.grid[tuple(cells.T)].all())
