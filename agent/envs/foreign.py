"""Any environment of Gymnasium's, seen as this project's agents see one.

Owns what is made of its observations and actions: ``rgb`` of the camera's size, ``depth`` where there is one,
``task`` from every other number, actions in [-1, 1]. What it rewards and when it ends are its own affair.
"""

import contextlib
import logging
from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float32, UInt8

from langwm_data.config_io import ConfigError

log = logging.getLogger(__name__)

_PICTURES = ("rgb", "depth")
Size = tuple[int, int]


class ForeignEnv(
    gymnasium.Wrapper[dict[str, np.ndarray], np.ndarray, Any, np.ndarray],
    gymnasium.utils.RecordConstructorArgs,
):
    """``env`` with the observation and the action that agents know.

    ``task`` holds every entry but ``rgb`` and ``depth`` one after another, in the order of their names; where
    there are none it is one zero. Frames are resized to ``size``, depth by its nearest pixel.

    Args:
        env: Observes a picture, or a Dict with ``rgb``; acts by a Box with bounds.
        size: Height and width of frames.
        has_pixels: Frames are what ``render`` returns; an observation that is no Dict is left out.

    Raises:
        ConfigError: If it has no frames, or its actions have no bounds.
    """

    def __init__(self, env: gymnasium.Env, *, size: Size, has_pixels: bool = False) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self, size=size, has_pixels=has_pixels)
        gymnasium.Wrapper.__init__(self, env)
        self._size = size
        self._has_pixels = has_pixels
        self._entries = _entries_of(env, has_pixels=has_pixels)
        self._names = tuple(name for name in self._entries if name not in _PICTURES)
        self._low, self._high = _bounds_of(env)
        self.action_space = spaces.Box(-1.0, 1.0, (self._low.size,), np.float32)
        self.observation_space = self._space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode."""
        obs, info = self.env.reset(seed=seed, options=options)
        return self._convert(obs), info

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Take a step; what lies beyond [-1, 1] is clipped."""
        share = (np.clip(np.asarray(action, np.float64).ravel(), -1, 1) + 1) / 2
        asked = self._low + share * (self._high - self._low)
        space = self.env.action_space
        assert isinstance(space, spaces.Box)
        obs, reward, terminated, truncated, info = self.env.step(
            asked.reshape(space.shape).astype(space.dtype)
        )
        return self._convert(obs), float(reward), bool(terminated), bool(truncated), info

    def _space(self) -> spaces.Space[Any]:
        boxes = [self._entries[name] for name in self._names]
        low = [np.asarray(box.low, np.float32).ravel() for box in boxes] or [np.zeros(1, np.float32)]
        high = [np.asarray(box.high, np.float32).ravel() for box in boxes] or [np.ones(1, np.float32)]
        seen: dict[str, spaces.Space[Any]] = {
            "rgb": spaces.Box(0, 255, (*self._size, 3), np.uint8),
            "task": spaces.Box(np.concatenate(low), np.concatenate(high), dtype=np.float32),
        }
        if "depth" in self._entries:
            seen["depth"] = spaces.Box(0.0, np.inf, self._size, np.float32)
        return spaces.Dict(seen)

    def _convert(self, obs: Any) -> dict[str, np.ndarray]:  # noqa: ANN401
        held: Mapping[str, Any] = obs if isinstance(obs, Mapping) else {"rgb": obs}
        frame = self._render() if self._has_pixels else np.asarray(held["rgb"])
        numbers = [np.asarray(held[name], np.float32).ravel() for name in self._names]
        seen = {
            "rgb": _as_frame(frame, self._size),
            "task": np.concatenate(numbers) if numbers else np.zeros(1, np.float32),
        }
        if "depth" in self._entries:
            depth = np.asarray(held["depth"], np.float32)
            depth = depth.reshape(depth.shape[:2])
            seen["depth"] = _resized(depth, self._size, cv2.INTER_NEAREST)
        return seen

    def _render(self) -> np.ndarray:
        frame = self.env.render()
        if not isinstance(frame, np.ndarray):
            raise ConfigError(
                f"env.pixels needs an environment whose render returns a picture; {_name_of(self.env)}"
                f" returned {type(frame).__name__} (make it with render_mode='rgb_array')"
            )
        return frame


def adapt_env(env: gymnasium.Env, *, size: Size, has_pixels: bool = False) -> gymnasium.Env:
    """``env`` itself where it is already what agents know, in the right size, else in a ``ForeignEnv``.

    Raises:
        ConfigError: As ``ForeignEnv`` does.
    """
    return (
        env if _is_known(env, size) and not has_pixels else ForeignEnv(env, size=size, has_pixels=has_pixels)
    )


class _Refusing(gymnasium.Wrapper[Any, Any, Any, Any], gymnasium.utils.RecordConstructorArgs):
    """``env`` of that name, whose errors become sentences: what it lacks may show only once it is used."""

    def __init__(self, env: gymnasium.Env, name: str) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self, name=name)
        gymnasium.Wrapper.__init__(self, env)
        self._name = name

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        with _refusing(self._name, "reset"):
            return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401
        with _refusing(self._name, "stepped"):
            return self.env.step(action)

    def render(self) -> Any:  # noqa: ANN401
        with _refusing(self._name, "rendered"):
            return self.env.render()


@contextlib.contextmanager
def _refusing(name: str, done: str) -> Iterator[None]:
    """Turn whatever an environment raises while it is ``done`` into one sentence; ``DEBUG`` logs the rest."""
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:
        log.debug("env.id %r", name, exc_info=True)
        reason = " ".join(str(error).split()).rstrip(".")
        raise ConfigError(f"env.id {name!r} cannot be {done}: {type(error).__name__}: {reason}") from error


def make_foreign(name: str, kwargs: Mapping[str, Any], *, size: Size, has_pixels: bool) -> gymnasium.Env:
    """The registered environment of that name, adapted.

    Raises:
        ConfigError: If there is none, or it cannot be made or used; also later, when it breaks.
    """
    asked = {"render_mode": "rgb_array"} if has_pixels else {}
    with _refusing(name, "made"):
        env = _Refusing(gymnasium.make(name, **{**asked, **kwargs}), name)
    try:
        return adapt_env(env, size=size, has_pixels=has_pixels)
    except ConfigError:
        env.close()
        raise


def _is_known(env: gymnasium.Env, size: Size) -> bool:
    observation, action = env.observation_space, env.action_space
    entries = observation.spaces if isinstance(observation, spaces.Dict) else {}
    rgb, task = entries.get("rgb"), entries.get("task")
    return (
        isinstance(rgb, spaces.Box)
        and rgb.dtype == np.uint8
        and rgb.shape == (*size, 3)
        and isinstance(task, spaces.Box)
        and len(task.shape) == 1
        and set(entries) <= {"rgb", "depth", "task", "features"}
        and isinstance(action, spaces.Box)
        and len(action.shape) == 1
        and bool((action.low == -1).all() and (action.high == 1).all())
    )


def _entries_of(env: gymnasium.Env, *, has_pixels: bool) -> dict[str, spaces.Box]:
    """Boxes of the observation by name, sorted, with the frames among them unless they are rendered."""
    space = env.observation_space
    if isinstance(space, spaces.Dict):
        entries = {name: box for name, box in sorted(space.spaces.items()) if isinstance(box, spaces.Box)}
    else:
        entries = {"rgb": space} if isinstance(space, spaces.Box) and not has_pixels else {}
    if has_pixels:
        return {name: box for name, box in entries.items() if name != "rgb"}
    rgb = entries.get("rgb")
    if rgb is None or rgb.dtype != np.uint8 or len(rgb.shape) != 3 or rgb.shape[2] not in (1, 3):
        raise ConfigError(
            f"{_name_of(env)} observes {space}, which has no frames; allowed: a picture (H, W, 3) uint8, a"
            " Dict with such an rgb, or env.pixels=true where render draws one"
        )
    return entries


def _bounds_of(env: gymnasium.Env) -> tuple[np.ndarray, np.ndarray]:
    space = env.action_space
    if (
        not isinstance(space, spaces.Box)
        or not np.issubdtype(space.dtype, np.floating)
        or not np.isfinite([space.low, space.high]).all()
    ):
        raise ConfigError(
            f"{_name_of(env)} has actions {space}; allowed: a Box of numbers with finite bounds"
        )
    return space.low.astype(np.float64).ravel(), space.high.astype(np.float64).ravel()


def _as_frame(frame: np.ndarray, size: Size) -> UInt8[np.ndarray, "H W 3"]:
    if frame.shape[2] == 1:
        frame = np.repeat(frame, 3, axis=2)
    return _resized(frame.astype(np.uint8), size, cv2.INTER_AREA)


def _resized(
    picture: UInt8[np.ndarray, "h w 3"] | Float32[np.ndarray, "h w"], size: Size, method: int
) -> np.ndarray:
    if picture.shape[:2] == size:
        return picture
    return cv2.resize(picture, size[::-1], interpolation=method)


def _name_of(env: gymnasium.Env) -> str:
    return f"env {env.spec.id!r}" if env.spec is not None else f"env {type(env.unwrapped).__name__}"
