"""The environment: what is seen, driven in, rewarded and counted."""

import json
import math
from dataclasses import field
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from langwm_data.config import (
    CameraConfig,
    LabelsConfig,
    LightLimits,
    RenderConfig,
    RobotConfig,
    ScenesConfig,
)
from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Positive, PositiveInt


def _ascending(edges: tuple[float, ...]) -> tuple[float, ...]:
    if len(edges) < 2 or edges[0] <= 0 or any(a >= b for a, b in pairwise(edges)):
        raise ValueError("give at least two positive distances in ascending order")
    return edges


def _finite(kwargs: dict[str, Any]) -> dict[str, Any]:
    try:
        json.dumps(kwargs, allow_nan=False, default=str)
    except ValueError:
        raise ValueError("all numbers should be finite") from None
    return kwargs


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
class EpisodeRandomizeConfig(LightLimits):
    """What is drawn anew for every episode beside its materials. Source: ours (ADR-0013)."""

    lights: Literal["fixed", "episode"] = "fixed"
    """``fixed``: as ``render.lights`` says; ``episode``: drawn around it from the seed of the textures."""


@config
class WheelsConfig:
    """The two driven wheels, read where ``action`` is ``wheel``.

    Source: iGibson 1.0 (velocity of a joint without limits); ROS TurtleBot description, approximately.
    """

    max_rad_s: Positive = 15.0
    """Turning speed of a wheel at an entry of 1."""
    radius_m: Positive = 0.035
    """With ``max_rad_s``: 5.25 cm per step at most."""
    axle_m: Positive = 0.23
    """Between the wheels: 4.6 rad/s on the spot at most."""


@config
class EnvConfig:
    """PointGoal navigation, or any environment of Gymnasium's.

    Source: iGibson turtlebot_point_nav.yaml unless said otherwise.
    """

    id: str | None = None
    """Another environment, named as ``gymnasium.make`` names it (``module:Name`` imports the module first).
    Of the fields below it reads ``kwargs``, ``pixels`` and the camera's size alone. None: PointGoal
    navigation."""
    kwargs: Annotated[dict[str, Any], AfterValidator(_finite)] = field(default_factory=dict, hash=False)
    """What ``gymnasium.make`` is given beside ``id``."""
    pixels: bool = False
    """Frames of ``id`` are what it renders; they take the place of an observation that is one vector."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    scenes: ScenesConfig = field(default_factory=ScenesConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    randomize: EpisodeRandomizeConfig = field(default_factory=EpisodeRandomizeConfig)
    labels: LabelsConfig = field(default_factory=LabelsConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    protocol: Literal["igibson", "habitat"] = "igibson"
    """``igibson``: arriving within ``success_radius_m`` is noticed and ends the episode; ``habitat``: the
    agent ends it by a stop action, one more entry, and succeeds within ``stop_radius_m`` of the goal."""
    action: Literal["velocity", "wheel", "kinematic"] = "velocity"
    """What the first two entries of an action mean: speeds forwards and of turning; of the left and the right
    wheel; metres forwards and radians to the left. Source: method notes, decision 23."""
    contacts: Literal["physics", "map"] = "physics"
    """``physics``: solids as they stand, by PyBullet; ``map``: their outlines seen from above, for which
    PyBullet need not be installed. The robot slides along both. Source: ours (ADR-0018)."""
    with_start_pose: bool = False
    """Add x, y in metres and yaw in radians to the task observation, in the frame of the start.
    Source: method notes, decision 22."""
    max_linear_m_s: Positive = 0.5
    """``velocity``: speed of action (1, 0), 5 cm per step; (-1, 0) drives backwards. Source: method notes,
    decision 23."""
    max_angular_rad_s: Positive = math.pi / 2
    """``velocity``: turning speed of action (0, 1), 9 degrees to the left per step. Source: method notes,
    decision 23."""
    max_forward_m: Positive = 0.05
    """``kinematic``: metres driven by action (1, 0); as far as ``velocity`` in a step. Source: ours."""
    max_turn_rad: Annotated[float, Field(gt=0, le=math.pi)] = math.pi / 20
    """``kinematic``: radians turned by action (0, 1), before driving; as many as ``velocity``.
    Source: ours."""
    wheels: WheelsConfig = field(default_factory=WheelsConfig)
    step_s: Positive = 0.1
    """Simulated time of one step."""
    physics_hz: PositiveInt = 240
    max_steps: PositiveInt = 500
    """The episode is truncated here."""
    success_radius_m: Positive = 0.36
    """``igibson``: straight distance in the plane below which the goal counts as reached."""
    stop_radius_m: Positive = 0.2
    """``habitat``: length of the shortest way to the goal below which stopping is a success.
    Source: habitat-lab."""
    stop_above: Annotated[float, Field(gt=-1, lt=1)] = 0.5
    """``habitat``: the last entry of an action stops above this. At 0.5 a uniform one stops one time in four,
    as a random choice of Habitat's four actions does. Source: ours (ADR-0018)."""
    distance_edges_m: Annotated[tuple[float, ...], AfterValidator(_ascending)] = (1.0, 3.0, 6.0, 10.0)
    """Edges of the tiers of geodesic distance from start to goal; the first and last bound all of them."""
    drawn_tiers: PositiveInt | None = None
    """Episodes that are drawn, not given, lie in the nearest so many tiers; in all of them when None. So an
    agent can be scored on goals farther away than those it learned on."""
    with_labels: bool = False
    """Add ``info["objects"]`` and ``info["instance"]``: what online finetuning of the MAE needs."""
    is_blind: bool = False
    """Black frames in place of rendering: many times faster, for policies that read the task entry alone."""
    seed_eval: int = 0
    """Seed of the fixed evaluation episodes."""

    def __post_init__(self) -> None:
        """Refuse lights that the renderer lacks, tiers that there are not, and words without an env."""
        if self.id is None and (self.kwargs or self.pixels):
            raise ConfigError("env.kwargs and env.pixels are of another environment; give env.id as well")
        if self.randomize.lights != "fixed" and self.render.backend == "tiny":
            raise ConfigError(
                f"env.randomize.lights {self.randomize.lights} needs env.render.backend auto, gl or embree"
            )
        num_tiers = len(self.distance_edges_m) - 1
        if self.drawn_tiers is not None and self.drawn_tiers > num_tiers:
            raise ConfigError(
                f"env.drawn_tiers {self.drawn_tiers} is not allowed:"
                f" env.distance_edges_m has {num_tiers} tiers"
            )
