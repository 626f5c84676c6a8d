"""Drives through free space: what the robot would see if it went from one random place to the next.

Owns the robot's motion without physics: as nothing is touched, driving is geometry. A drive depends on its
generator and the free space alone, so any worker can make any frame of it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.navigation import FreeSpace

MAX_LINEAR_M_S = 0.5
MAX_ANGULAR_RAD_S = math.pi / 2
STEP_S = 0.1
"""What an action of (1, 1) means, and how long it is held. Source: agent.config.EnvConfig."""

_ARRIVED_M = 0.3
"""This close to its goal the robot takes another."""
_LOOK_AHEAD_M = 0.8
"""It steers towards a point of its way at most this far ahead. Source: pure pursuit (Coulter 1992)."""
_GAIN = 2.0
"""rad/s of turning for each radian between its heading and that point."""
_MAX_TURN_CHANGE = 0.25
_MAX_SPEEDUP = 0.2
"""Most by which the two entries of an action change in a step; it may brake at once."""
_START_SPREAD_RAD = 0.5
"""Standard deviation of the first heading around the way."""
_SPEEDS = (0.5, 1.0)
"""Least and greatest speed on a straight way, in units of the limit; one is drawn for each goal."""
_SLOWER = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Shares of the wanted speed that are tried; turning on the spot is always possible."""
_STUCK_SPEED, _STUCK_RAD = 1e-3, 1e-2
"""A robot that stands although it faces the way gets another goal."""
_WAY_SPACING_M = 0.05
_SIGHT_SPACING_M = 0.01
_STEP_TOLERANCE = 1e-6
"""Metres and radians by which processors may differ."""

Floats = NDArray[np.float64]
XY = tuple[float, float]
Action = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Where the robot is after an action."""

    xy: XY
    """Metres."""
    yaw_rad: float
    """Counter-clockwise from +x, in [-pi, pi]."""
    action: Action = (0.0, 0.0)
    """Forward and turning speed that led here, in units of their limits, left positive."""


def drive(pose: Pose, action: Action, duration_s: float = STEP_S) -> Pose:
    """The pose after both speeds of ``action`` were held for ``duration_s``: an arc of a circle."""
    turn_rad = action[1] * MAX_ANGULAR_RAD_S * duration_s
    chord_m = action[0] * MAX_LINEAR_M_S * duration_s * np.sinc(turn_rad / (2 * math.pi))
    middle = pose.yaw_rad + turn_rad / 2
    xy = (
        float(pose.xy[0] + chord_m * math.cos(middle)),
        float(pose.xy[1] + chord_m * math.sin(middle)),
    )
    return Pose(xy=xy, yaw_rad=math.remainder(pose.yaw_rad + turn_rad, 2 * math.pi), action=action)


def step_fault(space: FreeSpace, before: Pose, after: Pose) -> str:
    """Why the action of ``after`` does not lead to it from ``before``; empty where it does.

    Args:
        space: Where the robot may be, all along the way.
        before: Where the robot was ``STEP_S`` earlier.
        after: Where it is said to be, and the action that is said to have led there.
    """
    again = drive(before, after.action)
    turn_rad = abs(math.remainder(again.yaw_rad - after.yaw_rad, 2 * math.pi))
    if math.dist(again.xy, after.xy) > _STEP_TOLERANCE or turn_rad > _STEP_TOLERANCE:
        x, y, yaw = *again.xy, again.yaw_rad
        return f"its action leads from the frame before to {x:.4f}, {y:.4f}, {yaw:.4f}, not to its pose"
    if not _is_free(space, _arc(before, after.action)):
        return "its action leads from the frame before through an obstacle"
    return ""


def simulate_trajectory(rng: np.random.Generator, space: FreeSpace, length: int) -> list[Pose]:
    """``length`` poses, one every ``STEP_S``, from a random place by way of random goals.

    Args:
        rng: Draws start, goals, and how briskly the robot drives to each of them.
        space: Every point of its free cells is a place where the robot may be.
        length: Poses, the first included.
    """
    x, y = space.sample(rng).tolist()
    way = _sample_way(rng, space, (x, y))
    heading = _bearing_rad((x, y), way[_farthest_clear(space, way, (x, y))])
    heading += rng.normal(0.0, _START_SPREAD_RAD)
    poses = [Pose(xy=(x, y), yaw_rad=math.remainder(heading, 2 * math.pi))]
    while True:
        ahead = _follow(space, way, poses[-1], speed=rng.uniform(*_SPEEDS))
        poses += islice(ahead, length - len(poses))
        if len(poses) == length:
            return poses
        way = _sample_way(rng, space, poses[-1].xy)


def _sample_way(rng: np.random.Generator, space: FreeSpace, xy: XY) -> Floats:
    """The shortest way to a random goal, as points (N, 2) that lie close together."""
    corners = space.distance_field(space.sample(rng)).path(xy)
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
    points = np.linspace(0.0, along[-1], 2 + int(along[-1] / _WAY_SPACING_M))
    return np.column_stack([np.interp(points, along, corners[:, axis]) for axis in (0, 1)])


def _follow(space: FreeSpace, way: Floats, pose: Pose, *, speed: float) -> Iterator[Pose]:
    """The poses after this one, until the robot has arrived or cannot go on.

    It steers towards a point of the way that moves on as the robot does, and only ever forwards.
    """
    target = 0
    while math.dist(pose.xy, way[-1]) >= _ARRIVED_M:
        target = _farthest_clear(space, way, pose.xy, start=target)
        error = math.remainder(_bearing_rad(pose.xy, way[target]) - pose.yaw_rad, 2 * math.pi)
        action = _choose_action(space, pose, error, speed)
        if action[0] < _STUCK_SPEED and abs(error) < _STUCK_RAD:
            return
        pose = drive(pose, action)
        yield pose


def _farthest_clear(space: FreeSpace, way: Floats, xy: XY, *, start: int = 0) -> int:
    """The last point of the way, from ``start`` on, before one that is hidden or too far ahead."""
    while start + 1 < len(way) and math.dist(xy, way[start + 1]) <= _LOOK_AHEAD_M:
        if not _is_free(space, _straight(np.asarray(xy), way[start + 1])):
            break
        start += 1
    return start


def _choose_action(space: FreeSpace, pose: Pose, error_rad: float, speed: float) -> Action:
    """Turn towards what lies ``error_rad`` to the left, and drive as fast as that and the walls allow."""
    wanted_turn = min(max(_GAIN * error_rad / MAX_ANGULAR_RAD_S, -1.0), 1.0)
    turn = pose.action[1] + min(max(wanted_turn - pose.action[1], -_MAX_TURN_CHANGE), _MAX_TURN_CHANGE)
    wanted = min(speed * max(math.cos(error_rad), 0.0) ** 2, pose.action[0] + _MAX_SPEEDUP)
    for share in _SLOWER:
        action = (share * wanted, turn)
        if _is_free(space, _arc(pose, action)):
            return action
    raise AssertionError("a robot that turns on the spot stays where it is")


def _arc(pose: Pose, action: Action) -> Floats:
    """Points (4, 2) of the way on which an action leads."""
    return np.array([drive(pose, action, STEP_S * part / 4).xy for part in range(1, 5)])


def _bearing_rad(xy: XY, point: Floats) -> float:
    x, y = (point - xy).tolist()
    return math.atan2(y, x)


def _straight(start: Floats, stop: Floats) -> Floats:
    """Points (N, 2) from ``start`` to ``stop``."""
    num = 2 + int(math.dist(start, stop) / _SIGHT_SPACING_M)
    return start + np.linspace(0.0, 1.0, num)[:, None] * (stop - start)


def _is_free(space: FreeSpace, points: Floats) -> bool:
    """Whether all points (N, 2) lie in free cells."""
    cells = np.floor((points - space.origin) / space.resolution_m).astype(int)
    is_inside = ((cells >= 0) & (cells < space.grid.shape)).all()
    return bool(is_inside and space.grid[tuple(cells.T)].all())
