"""The robot in a scene: an upright cylinder that moves in the plane, stops at obstacles or slides along them.

PyBullet answers how far the robot is from each obstacle; the motion itself is kinematic, so that a state
depends on the scene, the reset and the actions only.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RobotConfig
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.collision import Gap, Solids

SKIN_M = 0.001
"""The robot is kept this far from obstacles."""
CONTACT_M = 0.00001
"""It touches an obstacle when it comes this close to its skin."""

XY = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class RobotState:
    """Where the robot is, and how it moved last."""

    xy: XY
    """Metres."""
    yaw: float
    """Radians, counter-clockwise from +x, in (-pi, pi]."""
    linear: float
    """Speed forwards in m/s that the last substep really reached."""
    angular: float
    """rad/s, left positive."""
    is_collision: bool
    """Whether anything but the floor was touched in the last step."""


class World:
    """One scene with one robot in it."""

    def __init__(self, scene: SceneSpec, robot: RobotConfig, physics_hz: int = 240) -> None:
        flat = {s.instance for s in scene.surfaces if s.kind != "wall"}
        self._robot = robot
        self._physics_hz = physics_hz
        self._solids = Solids(scene, keep=lambda instance: instance not in flat)
        # The part of the robot above what it drives over.
        self._body = self._solids.cylinder(robot.radius_m, robot.height_m - robot.clearance_m)
        self._xy: NDArray[np.float64] = np.zeros(2)
        self._yaw = 0.0

    def reset(self, xy: XY, yaw: float) -> RobotState:
        """Put the robot at ``xy``, at rest.

        Raises:
            ValueError: If something else is there.
        """
        if self.collides(xy, yaw):
            raise ValueError(f"the robot cannot stand at ({xy[0]:.2f}, {xy[1]:.2f}): the place is taken")
        self._xy, self._yaw = np.array(xy, np.float64), float(yaw)
        return self._state(linear=0.0, angular=0.0, is_collision=False)

    def step(self, linear_m_s: float, angular_rad_s: float, dt: float = 0.1) -> RobotState:
        """Drive with the given speeds for ``dt`` seconds."""
        num = max(1, round(dt * self._physics_hz))
        duration = dt / num
        # What is out of reach for the whole step need not be asked about in each substep.
        reach = abs(linear_m_s) * dt + 2 * SKIN_M
        nearby = [n for n in self._nearby(self._xy, reach) if self._gaps(self._xy, [n], reach)]
        is_collision, linear = False, linear_m_s
        for _ in range(num):
            middle = self._yaw + 0.5 * angular_rad_s * duration
            forward = np.array([math.cos(middle), math.sin(middle)])
            wanted = linear_m_s * duration * forward
            moved, touches = self._advance(wanted, nearby)
            self._yaw += angular_rad_s * duration
            is_collision = is_collision or touches
            linear = float(moved @ forward) / duration
        return self._state(linear=linear, angular=angular_rad_s, is_collision=is_collision)

    def collides(self, xy: XY, yaw: float) -> bool:
        """Whether a robot at ``xy`` would touch anything but the floor."""
        place = np.array(xy, np.float64)
        return any(gap.distance <= SKIN_M for gap in self._gaps(place, self._nearby(place, SKIN_M), SKIN_M))

    def close(self) -> None:
        """Free the simulator; a second call does nothing."""
        self._solids.close()

    def _nearby(self, xy: NDArray[np.float64], reach_m: float) -> list[int]:
        """Numbers of the solids that the robot at ``xy`` may touch when it moves by ``reach_m``."""
        around = self._robot.radius_m + reach_m
        low = (xy[0] - around, xy[1] - around, self._robot.clearance_m)
        high = (xy[0] + around, xy[1] + around, self._robot.height_m)
        return self._solids.near(low, high).tolist()

    def _gaps(self, xy: NDArray[np.float64], nearby: list[int], within_m: float) -> list[Gap]:
        middle = (xy[0], xy[1], 0.5 * (self._robot.clearance_m + self._robot.height_m))
        body = dataclasses.replace(self._body, position=middle)
        gaps = (self._solids.gap_from(body, number, within_m) for number in nearby)
        return [gap for gap in gaps if gap is not None]

    def _advance(self, wanted: NDArray[np.float64], nearby: list[int]) -> tuple[NDArray[np.float64], bool]:
        """Move by ``wanted``, or by what obstacles leave of it; also whether one is touched."""
        gaps = self._gaps(self._xy, nearby, math.hypot(*wanted) + 2 * SKIN_M) if nearby else ()
        if not gaps:
            self._xy = self._xy + wanted
            return wanted, False
        normals = np.array([gap.normal[:2] for gap in gaps]).reshape(-1, 2)
        room = np.array([gap.distance - SKIN_M for gap in gaps])
        moved = slide(wanted, normals, room)
        self._xy = self._xy + moved
        return moved, bool((room + normals @ moved <= CONTACT_M).any())

    def _state(self, *, linear: float, angular: float, is_collision: bool) -> RobotState:
        yaw = math.pi - (math.pi - self._yaw) % (2 * math.pi)
        x, y = self._xy.tolist()
        return RobotState(xy=(x, y), yaw=yaw, linear=linear, angular=angular, is_collision=is_collision)


def slide(
    wanted: NDArray[np.float64], normals: NDArray[np.float64], room: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The part of a planar motion that obstacles leave.

    Each obstacle lies behind a plane; as the robot and every solid are convex, a motion that stays before
    all planes cannot penetrate.

    Args:
        wanted: (2,), metres.
        normals: (N, 2), from the obstacles to the robot, at most unit length.
        room: (N,), how far the robot may go against each normal, metres; may be a little negative.
    """
    room = np.maximum(room, 0.0)
    if (-(normals @ wanted) <= room).all():
        return wanted
    moved = wanted.copy()
    # Two rounds settle a corner; what still does not fit is a wedge, where the robot stops.
    for _ in range(2):
        for normal, limit in zip(normals, room, strict=True):
            excess = -(moved @ normal) - limit
            if excess > 0:
                moved = moved + normal * (excess / (normal @ normal))
    if (-(normals @ moved) > room + 1e-9).any():
        return np.zeros(2)
    return moved
