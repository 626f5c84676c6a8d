"""When an episode has succeeded and when it is over, by one of two protocols with names.

``igibson``: arriving is noticed. The first step that ends with the goal straight less than
``config.success_radius_m`` (0.36 m) away is a success and ends the episode. There is no stop action.
``habitat``: the agent has to say that it has arrived. Its stop action ends the episode, and that is a success
if the shortest way to the goal is then less than ``config.stop_radius_m`` (0.2 m) long.

Nothing else differs: path length, SoftSPL and distance to goal are measured alike, and time that runs out is
no success and truncates. So the same drive has the same measures but for success and, with it, SPL.
Source: iGibson 1.0 turtlebot_point_nav.yaml; habitat-lab tasks/nav/nav.py; method notes, section 6.
"""

from dataclasses import dataclass

from agent.config import EnvConfig


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """How an episode stands after a step."""

    is_success: bool
    is_over: bool
    """Whether it has come to an end other than by time."""


def judge(config: EnvConfig, *, straight_m: float, geodesic_m: float, is_stop: bool) -> Verdict:
    """The verdict of ``config.protocol``.

    Args:
        config: Names the protocol and has its radius.
        straight_m: Straight distance to the goal.
        geodesic_m: Length of the shortest way to it.
        is_stop: Whether the agent stopped.
    """
    if config.protocol == "habitat":
        return Verdict(is_success=is_stop and geodesic_m < config.stop_radius_m, is_over=is_stop)
    has_arrived = straight_m < config.success_radius_m
    return Verdict(is_success=has_arrived, is_over=has_arrived)


def success_radius(config: EnvConfig) -> tuple[str, float]:
    """The field that says how near the goal counts as reached, and its value in metres."""
    field = "stop_radius_m" if config.protocol == "habitat" else "success_radius_m"
    return field, getattr(config, field)
