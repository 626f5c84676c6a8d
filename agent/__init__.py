"""Stage three of LanGWM: PointGoal navigation with a world model on language-grounded features.

Importing this registers ``LangWM/PointNav-v0`` with Gymnasium.
"""

from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from agent.evaluate import evaluate_agent
    from agent.systems.agent import Agent
    from agent.train import train_agent

__all__ = ["Agent", "evaluate_agent", "train_agent"]

gymnasium.register(id="LangWM/PointNav-v0", entry_point="agent.envs.pointnav:PointNavEnv")


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import what is asked for only then, so that the command line answers at once."""
    if name == "Agent":
        from agent.systems.agent import Agent

        return Agent
    if name == "evaluate_agent":
        from agent.evaluate import evaluate_agent

        return evaluate_agent
    if name == "train_agent":
        from agent.train import train_agent

        return train_agent
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
