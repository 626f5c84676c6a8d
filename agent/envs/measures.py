"""How an episode is scored: success, SPL, SoftSPL and what they are made of. Lengths in metres."""

import math
from dataclasses import dataclass


def path_efficiency(shortest_m: float, path_m: float) -> float:
    """Shortest length over length taken, at most 1.

    Standing on the goal and staying there is perfectly efficient; a goal that cannot be reached never is.
    """
    if not math.isfinite(shortest_m):
        return 0.0
    longest = max(shortest_m, path_m)
    return shortest_m / longest if longest > 0 else 1.0


def spl(is_success: bool, shortest_m: float, path_m: float) -> float:
    """Success weighted by path length. Source: Anderson et al. 2018, On Evaluation of Embodied Navigation."""
    return path_efficiency(shortest_m, path_m) if is_success else 0.0


def soft_spl(final_m: float, shortest_m: float, path_m: float) -> float:
    """SPL with the share of the way that was covered in the place of success.

    Args:
        final_m: Geodesic distance to the goal at the end.
        shortest_m: Geodesic distance from start to goal.
        path_m: Length of the path taken.

    Source: habitat-lab, tasks/nav/nav.py.
    """
    if not shortest_m > 0:
        return path_efficiency(shortest_m, path_m) if final_m <= 0 else 0.0
    progress = max(0.0, 1.0 - final_m / shortest_m) if math.isfinite(shortest_m) else 0.0
    return progress * path_efficiency(shortest_m, path_m)


@dataclass
class EpisodeMeasures:
    """Running measures of one episode. Every step counts, the last one included."""

    geodesic_distance: float
    """From start to goal."""
    position: tuple[float, float]
    """Where the robot is now."""
    distance_to_goal: float
    """Geodesic, now."""
    path_length: float = 0.0
    collisions: int = 0
    """Steps in contact with an obstacle."""
    is_success: bool = False

    def update(
        self, xy: tuple[float, float], distance_to_goal: float, *, is_collision: bool, is_success: bool
    ) -> None:
        """Take in where one more step led."""
        self.path_length += math.dist(xy, self.position)
        self.position = xy
        self.distance_to_goal = distance_to_goal
        self.collisions += is_collision
        self.is_success = is_success

    def as_info(self) -> dict[str, float | int | bool]:
        """The measures under their names in ``info``."""
        return {
            "success": self.is_success,
            "spl": spl(self.is_success, self.geodesic_distance, self.path_length),
            "soft_spl": soft_spl(self.distance_to_goal, self.geodesic_distance, self.path_length),
            "distance_to_goal": self.distance_to_goal,
            "path_length": self.path_length,
            "geodesic_distance": self.geodesic_distance,
            "collisions": self.collisions,
        }
