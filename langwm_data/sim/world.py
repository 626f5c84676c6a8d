"""The robot in a scene: an upright cylinder that moves in the plane, stops at obstacles or slides along them.

``obstacles`` answers how far the robot is from each obstacle, by PyBullet or by the map; the motion itself is
kinematic, so that a state depends on the scene, the reset and the actions only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from langwm_data.config import RobotConfig
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.obstacles import XY, Contacts, PlanarGap, make_obstacles

SKIN_M = 0.001
"""The robot is kept this far from obstacles."""
CONTACT_M = 0.00001
"""It touches an obstacle when it comes this close to its skin."""


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
    """One scene with one robot in it.

    Args:
        scene: The scene, its loose things at rest.
        robot: Radius, height and clearance.
        physics_hz: Near obstacles the robot moves in steps of this many to a second.
        contacts: What answers how near obstacles are; see ``obstacles``.
    """

    def __init__(
        self, scene: SceneSpec, robot: RobotConfig, physics_hz: int = 240, contacts: Contacts = "physics"
    ) -> None:
        self._physics_hz = physics_hz
        self._obstacles = make_obstacles(scene, robot, contacts)
        self._x = self._y = self._yaw = 0.0

    def reset(self, xy: XY, yaw: float) -> RobotState:
        """Put the robot at ``xy``, at rest.

        Raises:
            ValueError: If something else is there.
        """
        if self.collides(xy, yaw):
            raise ValueError(f"the robot cannot stand at ({xy[0]:.2f}, {xy[1]:.2f}): the place is taken")
        self._x, self._y, self._yaw = float(xy[0]), float(xy[1]), float(yaw)
        return self._state(linear=0.0, angular=0.0, is_collision=False)

    def step(
        self, linear_m_s: float, angular_rad_s: float, dt: float = 0.1, *, turns_first: bool = False
    ) -> RobotState:
        """Drive with the given speeds for ``dt`` seconds: along an arc, or first turning, then straight."""
        curving = angular_rad_s
        if turns_first:
            self._yaw, curving = self._yaw + angular_rad_s * dt, 0.0
        # What is out of reach for the whole step need not be asked about on the way.
        reach = abs(linear_m_s) * dt + 2 * SKIN_M
        rooms = {n: gap.distance for n, gap in self._gaps((self._x, self._y), reach)}
        if rooms:
            linear, is_collision = self._feel_the_way(linear_m_s, curving, dt, rooms, reach)
        else:
            linear, is_collision = linear_m_s, False
            self._drive_freely(linear_m_s * dt, curving * dt)
        return self._state(linear=linear, angular=angular_rad_s, is_collision=is_collision)

    def collides(self, xy: XY, yaw: float) -> bool:
        """Whether a robot at ``xy`` would touch anything but the floor."""
        return bool(self._gaps(xy, SKIN_M))

    def close(self) -> None:
        """Free the simulator; a second call does nothing."""
        self._obstacles.close()

    def _gaps(self, xy: XY, within_m: float) -> list[tuple[int, PlanarGap]]:
        """Obstacles no further than ``within_m`` from a robot at ``xy``."""
        ask = self._obstacles
        gaps = ((number, ask.gap(number, xy, within_m)) for number in ask.near(xy, within_m))
        return [(number, gap) for number, gap in gaps if gap is not None]

    def _drive_freely(self, distance_m: float, turn_rad: float) -> None:
        """Follow an arc that long, which turns by ``turn_rad``."""
        half = 0.5 * turn_rad
        chord = distance_m * math.sin(half) / half if half else distance_m
        self._x += chord * math.cos(self._yaw + half)
        self._y += chord * math.sin(self._yaw + half)
        self._yaw += turn_rad

    def _feel_the_way(
        self, linear_m_s: float, angular_rad_s: float, dt: float, rooms: dict[int, float], reach: float
    ) -> tuple[float, bool]:
        """Drive in small steps, each as far as obstacles let the robot.

        Args:
            linear_m_s: Speed that is wanted.
            angular_rad_s: Turning speed.
            dt: Seconds.
            rooms: How near each obstacle is, by its number; shrinks by what is driven, until asked again.
            reach: How far to look when asking.

        Returns:
            The speed forwards of the last small step, and whether anything was touched.
        """
        num = max(1, round(dt * self._physics_hz))
        duration = dt / num
        wanted, turn = linear_m_s * duration, angular_rad_s * duration
        linear, is_collision = linear_m_s, False
        for _ in range(num):
            forward_x, forward_y = math.cos(self._yaw + 0.5 * turn), math.sin(self._yaw + 0.5 * turn)
            moved = wanted * forward_x, wanted * forward_y
            gaps = self._close_ones(rooms, abs(wanted) + 2 * SKIN_M, reach)
            if gaps:
                moved, touches = _advance(moved, gaps)
                is_collision = is_collision or touches
            self._x, self._y, self._yaw = self._x + moved[0], self._y + moved[1], self._yaw + turn
            driven = math.hypot(*moved)
            for number in rooms:
                rooms[number] -= driven
            linear = (moved[0] * forward_x + moved[1] * forward_y) / duration
        return linear, is_collision

    def _close_ones(self, rooms: dict[int, float], within_m: float, reach: float) -> list[PlanarGap]:
        """Gaps to obstacles no further than ``within_m``; only those are asked about that may be so near."""
        close = []
        for number, room in rooms.items():
            if room <= within_m:
                gap = self._obstacles.gap(number, (self._x, self._y), reach)
                rooms[number] = reach if gap is None else gap.distance
                if gap is not None and gap.distance <= within_m:
                    close.append(gap)
        return close

    def _state(self, *, linear: float, angular: float, is_collision: bool) -> RobotState:
        yaw = math.pi - (math.pi - self._yaw) % (2 * math.pi)
        return RobotState(
            xy=(self._x, self._y), yaw=yaw, linear=linear, angular=angular, is_collision=is_collision
        )


def _advance(wanted: XY, gaps: Sequence[PlanarGap]) -> tuple[XY, bool]:
    """What obstacles leave of a motion; also whether one is touched."""
    normals = [(gap.x, gap.y) for gap in gaps]
    room = [gap.distance - SKIN_M for gap in gaps]
    moved = slide(wanted, normals, room)
    left = (r + x * moved[0] + y * moved[1] for r, (x, y) in zip(room, normals, strict=True))
    return moved, any(distance <= CONTACT_M for distance in left)


def slide(wanted: XY, normals: Sequence[XY], room: Sequence[float]) -> XY:
    """The part of a planar motion that obstacles leave.

    Each obstacle lies behind a plane; as the robot and every solid are convex, a motion that stays before
    all planes cannot penetrate.

    Args:
        wanted: Metres along x and y.
        normals: From the obstacles to the robot, at most unit length.
        room: How far the robot may go against each normal, metres; may be a little negative.
    """
    planes = [(x, y, max(limit, 0.0)) for (x, y), limit in zip(normals, room, strict=True)]
    move_x, move_y = wanted
    if all(-(x * move_x + y * move_y) <= limit for x, y, limit in planes):
        return wanted
    # Two rounds settle a corner; what still does not fit is a wedge, where the robot stops.
    for _ in range(2):
        for x, y, limit in planes:
            excess = -(x * move_x + y * move_y) - limit
            if excess > 0:
                share = excess / (x * x + y * y)
                move_x, move_y = move_x + x * share, move_y + y * share
    if any(-(x * move_x + y * move_y) > limit + 1e-9 for x, y, limit in planes):
        return 0.0, 0.0
    return move_x, move_y
