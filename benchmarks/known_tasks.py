"""Three small tasks that are not ours, drawn with numpy on 32 x 32 pixels, as Gymnasium environments.

``KnownTasks/Reach-v0``: a point drives to a goal on the square [-1, 1]. ``KnownTasks/Line-v0``: a mass on the
line [-1, 1] is pushed to rest in the middle. ``KnownTasks/Pendulum-v0``: Gymnasium's Pendulum-v1 drawn as a
bar, its rewards divided by ten. Importing this registers them.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import RescaleAction, TransformReward

from pretrain.frames import FrameObject

SIZE = 32
STEP = 0.2
REACHED = 0.2
RADIUS = 0.2
"""Of the two discs that ``Reach`` draws."""
GOAL, POINT = "chair", "table"
MIDDLE_M = {GOAL: 1.5, POINT: 3.5}
"""How far away they are in the middle of the frame: depth tells the two apart, as colour does."""
WALL_M = 5.0
"""How far away is what lies behind them."""
PUSH = 0.04
"""What an action of 1 adds to the speed of ``Line``, half widths of the frame per step."""

Obs = dict[str, np.ndarray]


class Reach(gymnasium.Env[Any, np.ndarray]):
    """A blue point drives to a red goal; the reward is what it came nearer, and 1 for arriving.

    Args:
        tells: Whether the way to the goal stands in ``offset`` too; else it has to be seen.
        labels: Whether ``info`` has the boxes of goal (a chair, as it were) and point (a table).
        depth: Whether ``depth`` is seen too: goal and point stand before a wall, the goal nearer than the
            point, each the farther the higher it stands in the frame.
    """

    def __init__(self, *, tells: bool = True, labels: bool = False, depth: bool = False) -> None:
        self._tells = tells
        self._labels = labels
        self._depth = depth
        self.action_space = spaces.Box(-STEP, STEP, (2,), np.float32)
        seen: dict[str, spaces.Space[Any]] = {"rgb": spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8)}
        if tells:
            seen["offset"] = spaces.Box(-2.0, 2.0, (2,), np.float32)
        if depth:
            seen["depth"] = spaces.Box(0.0, WALL_M, (SIZE, SIZE), np.float32)
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
        return self._observe(), self._info(is_success=False)

    def step(self, action: np.ndarray) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Move by ``action``, within the square."""
        before = np.linalg.norm(self._goal - self._place)
        self._place = np.clip(self._place + action, -1, 1)
        after = np.linalg.norm(self._goal - self._place)
        has_arrived = bool(after < REACHED)
        reward = float(before - after) + has_arrived
        return self._observe(), reward, has_arrived, False, self._info(is_success=has_arrived)

    def _info(self, *, is_success: bool) -> dict[str, Any]:
        if not self._labels:
            return {"success": is_success}
        return {"success": is_success, "objects": [_box(GOAL, self._goal), _box(POINT, self._place)]}

    def _observe(self) -> Obs:
        ink = [np.linalg.norm(self._grid - point, axis=-1) < RADIUS for point in (self._goal, self._place)]
        channels = np.stack([ink[0], np.zeros_like(ink[0]), ink[1]], axis=-1)
        seen = {"rgb": (255 * channels).astype(np.uint8)}
        if self._depth:
            near = [_distance_m(GOAL, self._goal), _distance_m(POINT, self._place)]
            seen["depth"] = np.select(ink, near, WALL_M).astype(np.float32)
        return seen | ({"offset": (self._goal - self._place).astype(np.float32)} if self._tells else {})


def _box(category: str, point: np.ndarray) -> FrameObject:
    x, y = (np.array([1, -1]) * point + 1) / 2 * SIZE
    half = RADIUS / 2 * SIZE
    box = (float(x - half), float(y - half), float(x + half), float(y + half))
    return FrameObject(
        category=category, bbox_xyxy=box, center_x=float(x), distance_m=_distance_m(category, point)
    )


def _distance_m(category: str, point: np.ndarray) -> float:
    """Low in the frame is near, as on a floor."""
    return MIDDLE_M[category] + 0.5 * float(point[1])


class Line(gymnasium.Env[Obs, np.ndarray]):
    """A mass that begins at rest; walls stop it; the reward is minus its distance from the middle.

    Args:
        is_blind: Whether frames are black; nothing else tells of place and speed.
    """

    def __init__(self, *, is_blind: bool = False) -> None:
        self._is_blind = is_blind
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = spaces.Dict(rgb=spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8))  # pyright: ignore[reportAttributeAccessIssue]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Obs, dict[str, Any]]:
        """Draw where the mass lies."""
        super().reset(seed=seed)
        self.place, self.speed = self.np_random.uniform(-1, 1), 0.0
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Push."""
        self.speed += PUSH * float(np.clip(action[0], -1, 1))
        wanted = self.place + self.speed
        self.place = float(np.clip(wanted, -1, 1))
        self.speed *= self.place == wanted
        return self._observe(), -abs(self.place), False, False, {}

    def _observe(self) -> Obs:
        """A bar of six pixels, smooth at its edges."""
        middle = SIZE / 2 + self.place * (SIZE / 2 - 4)
        ink = np.clip(3.5 - np.abs(np.arange(SIZE) + 0.5 - middle), 0, 1) * (not self._is_blind)
        picture = np.zeros((SIZE, SIZE, 3), np.uint8)
        picture[8:24] = (255 * ink).astype(np.uint8)[None, :, None]
        return {"rgb": picture}


class PixelPendulum(gymnasium.ObservationWrapper[Obs, np.ndarray, np.ndarray]):
    """Gymnasium's pendulum as a picture; its goal is to stand.

    Args:
        is_blind: Whether frames are black; nothing else tells of angle and speed.
    """

    def __init__(self, *, is_blind: bool = False) -> None:
        super().__init__(RescaleAction(gymnasium.make("Pendulum-v1"), np.float32(-1), np.float32(1)))
        self._is_blind = is_blind
        self.observation_space = spaces.Dict(rgb=spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8))  # pyright: ignore[reportAttributeAccessIssue]
        axis = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
        self._x, self._y = np.meshgrid(axis, -axis)

    def observation(self, observation: np.ndarray) -> Obs:
        """A bar from the middle; upright at angle 0, to the left at a quarter turn."""
        cosine, sine, _ = observation
        along = np.clip(self._y * cosine - self._x * sine, 0, 0.8)
        distance = np.hypot(self._x + along * sine, self._y - along * cosine)
        ink = np.clip((0.2 - distance) * SIZE / 2, 0, 1) * (not self._is_blind)
        return {"rgb": np.repeat((255 * ink[..., None]).astype(np.uint8), 3, -1)}


def make_pendulum(*, is_blind: bool = False) -> gymnasium.Env:
    """The pendulum with rewards between -1.63 and 0."""
    return TransformReward(PixelPendulum(is_blind=is_blind), lambda reward: 0.1 * float(reward))


gymnasium.register("KnownTasks/Reach-v0", entry_point=f"{__name__}:Reach", max_episode_steps=30)
gymnasium.register("KnownTasks/Line-v0", entry_point=f"{__name__}:Line", max_episode_steps=50)
gymnasium.register("KnownTasks/Pendulum-v0", entry_point=f"{__name__}:make_pendulum")
