"""The reward of one step."""

from agent.config import RewardConfig


def navigation_reward(
    config: RewardConfig, *, progress_m: float, is_collision: bool, is_success: bool
) -> float:
    """Progress towards the goal, less contact, plus arrival.

    Args:
        config: The weights.
        progress_m: Geodesic distance before the step minus after it.
        is_collision: Whether the robot touched an obstacle in this step; counted once.
        is_success: Whether the step arrived at the goal.

    Source: iGibson 1.0 tasks/point_nav_fixed_task.py, without its distances quantised to the grid.
    """
    return config.progress * progress_m + config.collision * is_collision + config.success * is_success
