"""An environment whose observation also has a vector that describes the frame."""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float32

Describe = Callable[[Mapping[str, np.ndarray], Mapping[str, Any]], Float32[np.ndarray, " V"]]
"""From observation and info of one step to the vector; the same every time."""


class FeatureEnv(gymnasium.Wrapper[dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray], np.ndarray]):
    """Adds the entry ``features``, float32, computed once a step.

    It is rounded to half precision, as the replay keeps it: what is learned from is what was acted on.

    Args:
        env: Observes a Dict.
        describe: Makes the vector.
        feature_dim: Its entries.
    """

    def __init__(self, env: gymnasium.Env, describe: Describe, feature_dim: int) -> None:
        super().__init__(env)
        self._describe = describe
        assert isinstance(env.observation_space, spaces.Dict)
        vector = spaces.Box(-np.inf, np.inf, (feature_dim,), np.float32)
        self.observation_space = spaces.Dict({**env.observation_space.spaces, "features": vector})  # pyright: ignore[reportAttributeAccessIssue]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode."""
        obs, info = self.env.reset(seed=seed, options=options)
        return self._add(obs, info), info

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Take a step."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        return self._add(obs, info), float(reward), terminated, truncated, info

    def _add(self, obs: dict[str, np.ndarray], info: dict[str, Any]) -> dict[str, np.ndarray]:
        vector = self._describe(obs, info).astype(np.float16).astype(np.float32)
        return {**obs, "features": vector}
