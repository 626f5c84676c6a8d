"""Everything that can be configured about stage three: environment, replay, world model, behaviour."""

import math
from dataclasses import field
from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field

from langwm_data.config import CameraConfig, LabelsConfig, RenderConfig, RobotConfig, ScenesConfig
from langwm_data.config_io import config

Positive = Annotated[float, Field(gt=0)]
PositiveInt = Annotated[int, Field(ge=1)]


def _ascending(edges: tuple[float, ...]) -> tuple[float, ...]:
    if len(edges) < 2 or edges[0] <= 0 or any(a >= b for a, b in pairwise(edges)):
        raise ValueError("give at least two positive distances in ascending order")
    return edges


@config
class RewardConfig:
    """Terms of the reward. Source: iGibson turtlebot_point_nav.yaml."""

    progress: float = 1.0
    """Per metre by which the geodesic distance to the goal shrinks."""
    collision: float = -0.1
    """Once for every step in contact with an obstacle."""
    success: float = 10.0
    """On arriving at the goal."""


@config
class EnvConfig:
    """PointGoal navigation. Source: iGibson turtlebot_point_nav.yaml unless said otherwise."""

    camera: CameraConfig = field(default_factory=CameraConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    scenes: ScenesConfig = field(default_factory=ScenesConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    labels: LabelsConfig = field(default_factory=LabelsConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    max_linear_m_s: Positive = 0.5
    """Speed of action (1, 0): 5 cm per step; (-1, 0) drives backwards. Source: method notes, decision 23."""
    max_angular_rad_s: Positive = math.pi / 2
    """Turning speed of action (0, 1): 9 degrees to the left per step. Source: method notes, decision 23."""
    step_s: Positive = 0.1
    """Simulated time of one step."""
    physics_hz: PositiveInt = 240
    max_steps: PositiveInt = 500
    """The episode is truncated here."""
    success_radius_m: Positive = 0.36
    """Straight distance in the plane below which the goal counts as reached."""
    distance_edges_m: Annotated[tuple[float, ...], AfterValidator(_ascending)] = (1.0, 3.0, 6.0, 10.0)
    """Edges of the tiers of geodesic distance from start to goal; the first and last bound all of them."""
    with_labels: bool = False
    """Add ``info["objects"]`` and ``info["instance"]``: what online finetuning of the MAE needs."""
    seed_eval: int = 0
    """Seed of the fixed evaluation episodes."""


@config
class ReplayConfig:
    """Buffer of whole episodes on disk."""

    capacity_steps: PositiveInt = 300_000
    """The oldest episodes leave when the buffer holds more steps than this. Source: Sec. 3.2."""
    prioritize_ends: bool = True
    """Draw chunks that contain an episode's end more often. Source: MWM configs.yaml (rlbench)."""
