"""The agent whose last episodes of training went best, kept beside the one that was trained last.

Owns what is best: of the checkpoints whose last ``WINDOW`` episodes were all of the learner's own, the one with
the highest share of successes in them, or the highest mean return where successes are equal or not known.
"""

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agent.envs.outcomes import Outcome
from agent.systems.agent import Agent

BEST_FOLDER = "best"
WINDOW = 20


class Best:
    """Writes ``RUN/best``, which ``Agent.from_pretrained`` reads.

    Args:
        run: Folder of the run.
        state: What ``state_dict`` returned, to go on from there.
    """

    def __init__(self, run: Path, state: Mapping[str, Any] | None = None) -> None:
        self._folder = run / BEST_FOLDER
        held = state or {"recent": [], "score": None}
        recent = [(success, total) for success, total in held["recent"]]
        self._recent: deque[tuple[float, float]] = deque(recent, maxlen=WINDOW)
        """Success and return of the last episodes."""
        self._score: tuple[float, ...] | None = held["score"] and tuple(held["score"])

    def add(self, outcome: Outcome) -> None:
        """Note an episode that the learner has played."""
        self._recent.append((float(outcome.success or False), outcome.total_reward))

    def keep(self, agent: Agent) -> None:
        """Write ``agent`` down if its last episodes were better than those of all before.

        Raises:
            OSError: If it cannot be written; the one before stays.
        """
        if len(self._recent) < WINDOW:
            return
        successes, returns = zip(*self._recent, strict=True)
        score = (sum(successes) / WINDOW, sum(returns) / WINDOW)
        if self._score is None or score > self._score:
            agent.save_pretrained(self._folder)
            self._score = score

    def state_dict(self) -> dict[str, Any]:
        """The last episodes and the best score."""
        return {"recent": [list(pair) for pair in self._recent], "score": self._score and list(self._score)}
