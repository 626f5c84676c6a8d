"""How a finished episode went, in PointGoal navigation and in any other environment.

Owns which of the two an environment is: PointGoal navigation says where the robot is (``info["pose"]``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

_SUCCESS_NAMES = ("success", "is_success")


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What is known of an episode of any environment."""

    num_steps: int
    total_reward: float
    success: bool | None
    """None where the environment does not say, by ``info["success"]`` or ``info["is_success"]``."""
    is_terminated: bool
    """False where time ran out."""

    def metrics(self) -> dict[str, float]:
        """Scalars as training logs them."""
        known = {} if self.success is None else {"env/success": float(self.success)}
        return {"env/return": self.total_reward, **known, "env/length": float(self.num_steps)}


@dataclass(frozen=True, kw_only=True)
class EpisodeRecord(Outcome):
    """An episode of PointGoal navigation. Lengths in metres."""

    success: bool
    scene: str
    tier: int
    spl: float
    soft_spl: float
    distance_to_goal: float
    path_length: float
    geodesic_distance: float
    collisions: int
    trajectory: Float64[np.ndarray, "T 3"]
    """x, y and yaw after the reset and after every step."""
    goal: Float64[np.ndarray, " 2"]
    """x and y."""

    def metrics(self) -> dict[str, float]:
        """Scalars as training logs them."""
        names = ("spl", "soft_spl", "distance_to_goal", "geodesic_distance", "collisions")
        return super().metrics() | {f"env/{name}": float(getattr(self, name)) for name in names}


class Recorder:
    """Collects one episode from the reset on.

    Args:
        info: What ``reset`` returned.
    """

    def __init__(self, info: Mapping[str, Any]) -> None:
        self._poses = [info["pose"]] if "pose" in info else None
        self._num_steps = 0
        self._total_reward = 0.0

    def add(self, reward: float, info: Mapping[str, Any]) -> None:
        """Note a step."""
        self._num_steps += 1
        self._total_reward += reward
        if self._poses is not None:
            self._poses.append(info["pose"])

    def finish(self, info: Mapping[str, Any], *, is_terminated: bool) -> Outcome:
        """How it went; an ``EpisodeRecord`` in PointGoal navigation."""
        success = next((bool(info[name]) for name in _SUCCESS_NAMES if name in info), None)
        shared: dict[str, Any] = {
            "num_steps": self._num_steps,
            "total_reward": self._total_reward,
            "success": success,
            "is_terminated": is_terminated,
        }
        if self._poses is None:
            return Outcome(**shared)
        names = ("scene", "tier", "spl", "soft_spl", "distance_to_goal", "path_length", "geodesic_distance")
        held = {name: info[name] for name in (*names, "collisions", "goal")}
        return EpisodeRecord(**shared, **held, trajectory=np.stack(self._poses))
