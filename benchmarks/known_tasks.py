"""Two small tasks that are not this project's, drawn with numpy on 32 x 32 pixels, as Gymnasium environments.

``KnownTasks/Reach-v0``: a point mass drives to a goal on the square [-1, 1]. ``KnownTasks/Pendulum-v0``:
Gymnasium's Pendulum-v1 drawn as a bar, its rewards divided by ten. Importing this registers both.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import TransformReward

from benchmarks.pendulum import PixelPendulum

SIZE = 32
STEP = 0.2
REACHED = 0.2
MAX_STEPS = 30

Obs = dict[str, np.ndarray]


class Reach(gymnasium.Env[Any, np.ndarray]):
    """A blue point drives to a red goal; the reward is what it came nearer, and 1 for arriving.

    Args:
        tells: Whether the way to the goal stands in ``offset`` too; else it has to be seen.
    """

    def __init__(self, *, tells: bool = True) -> None:
        self._tells = tells
        self.action_space = spaces.Box(-STEP, STEP, (2,), np.float32)
        seen: dict[str, spaces.Space[Any]] = {"rgb": spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8)}
        if tells:
            seen["offset"] = spaces.Box(-2.0, 2.0, (2,), np.float32)
        self.observation_space = spaces.Dict(seen)
        axis = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
        self._grid = np.stack(np.meshgrid(axis, -axis), axis=-1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Obs, dict[str, Any]]:
        """Draw start and goal, at least one unit apart."""
        super().reset(seed=seed)
        self._place, self._goal = self.np_random.uniform(-0.9, 0.9, (2, 2))
        while np.linalg.norm(self._goal - self._place) < 1:
            self._goal = self.np_random.uniform(-0.9, 0.9, 2)
        return self._observe(), {"success": False}

    def step(self, action: np.ndarray) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Move by ``action``, within the square."""
        before = np.linalg.norm(self._goal - self._place)
        self._place = np.clip(self._place + action, -1, 1)
        after = np.linalg.norm(self._goal - self._place)
        has_arrived = bool(after < REACHED)
        return (
            self._observe(),
            float(before - after) + has_arrived,
            has_arrived,
            False,
            {"success": has_arrived},
        )

    def _observe(self) -> Obs:
        ink = [np.linalg.norm(self._grid - point, axis=-1) < 0.2 for point in (self._goal, self._place)]
        channels = np.stack([ink[0], np.zeros_like(ink[0]), ink[1]], axis=-1)
        seen = {"rgb": (255 * channels).astype(np.uint8)}
        return seen | ({"offset": (self._goal - self._place).astype(np.float32)} if self._tells else {})


def make_pendulum(*, is_blind: bool = False) -> gymnasium.Env:
    """The pendulum with rewards between -1.63 and 0."""
    return TransformReward(PixelPendulum(is_blind=is_blind), lambda reward: 0.1 * float(reward))


gymnasium.register("KnownTasks/Reach-v0", entry_point=f"{__name__}:Reach", max_episode_steps=MAX_STEPS)
gymnasium.register("KnownTasks/Pendulum-v0", entry_point=f"{__name__}:make_pendulum")
