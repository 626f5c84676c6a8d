"""A policy in an environment: whole episodes for evaluation, single steps for training.

Owns the order of acting, stepping and recording, and how an unfinished episode is gone back to after a
restart. Knows no model: a policy is any function of observation and state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np

from agent.envs.episodes import Episode
from agent.envs.outcomes import Outcome, Recorder
from agent.replay import ReplayEpisode
from langwm_data.shards.sample import to_millimetres
from pretrain.frames import FrameObject


@runtime_checkable
class Policy(Protocol):
    """Chooses an action. ``state`` is whatever it remembers; None at the beginning of an episode."""

    def __call__(self, obs: Mapping[str, np.ndarray], state: Any) -> tuple[np.ndarray, Any]:  # noqa: ANN401
        """Return an action in [-1, 1] and the state to pass in at the next step."""
        ...


def run_episode(
    env: gymnasium.Env, policy: Policy, *, episode: Episode | None = None, seed: int | None = None
) -> Outcome:
    """Play one episode to its end.

    Args:
        env: Any environment with ``rgb`` and ``task``.
        policy: Begins with the state None.
        episode: Play this one, in PointGoal navigation; one drawn from ``seed`` when None.
        seed: Given to ``reset``.
    """
    options = None if episode is None else {"episode": episode}
    obs, info = env.reset(seed=seed, options=options)
    recorder = Recorder(info)
    state, terminated, truncated = None, False, False
    while not (terminated or truncated):
        action, state = policy(obs, state)
        obs, reward, terminated, truncated, info = env.step(action)
        recorder.add(float(reward), info)
    return recorder.finish(info, is_terminated=terminated)


@dataclass(frozen=True, kw_only=True)
class CollectedEpisode:
    """A finished episode of training: what the replay buffer stores, and how it went."""

    replay: ReplayEpisode
    record: Outcome


class Collector:
    """Steps one environment for training and hands over whole episodes.

    Episode k is played with the seed ``seed + k``, so the course of training depends on the seed and the
    actions alone. An unfinished episode is restored by taking its recorded actions again; what the
    policy remembers (``policy_state``) cannot be recomputed, because its weights have changed since, and
    belongs in the checkpoint beside ``state_dict``.

    Args:
        env: Any environment with ``rgb`` and ``task``; must be deterministic.
        seed: Seed of the first episode.
        state: What ``state_dict`` returned, to go on from there.
        with_depth: Whether finished episodes hold depth.
        with_objects: Whether they hold the labelled objects.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        *,
        seed: int,
        state: Mapping[str, Any] | None = None,
        with_depth: bool = True,
        with_objects: bool = True,
    ) -> None:
        self._env = env
        self._seed = seed
        self._with_depth = with_depth
        self._with_objects = with_objects
        self.num_episodes: int = state["num_episodes"] if state else 0
        """Finished so far."""
        self._begin()
        for action in state["actions"] if state else ():
            self._take(np.array(action, dtype=np.float32))
        self.policy_state: Any = None
        """What the policy returned last; None at the beginning of an episode."""

    def state_dict(self) -> dict[str, Any]:
        """How many episodes are finished, and the actions taken in the one under way, for JSON."""
        actions = [a.tolist() for a in self._actions[1:]]
        return {"num_episodes": self.num_episodes, "actions": actions}

    def step(self, policy: Policy) -> CollectedEpisode | None:
        """Take one step; the episode it finished, if it did. The next one is begun at once."""
        action, self.policy_state = policy(self._observations[-1], self.policy_state)
        terminated, truncated, info = self._take(np.asarray(action, dtype=np.float32))
        if not (terminated or truncated):
            return None
        finished = CollectedEpisode(
            replay=self._as_replay(is_terminal=terminated),
            record=self._recorder.finish(info, is_terminated=terminated),
        )
        self.num_episodes += 1
        self.policy_state = None
        self._begin()
        return finished

    def _begin(self) -> None:
        obs, info = self._env.reset(seed=self._seed + self.num_episodes)
        self._recorder = Recorder(info)
        self._observations = [_kept(obs)]
        shape = self._env.action_space.shape
        assert shape is not None, "the action space is a Box"
        self._actions = [np.zeros(shape, np.float32)]
        self._rewards = [0.0]
        self._objects: list[Sequence[FrameObject]] = [info.get("objects", ())]

    def _take(self, action: np.ndarray) -> tuple[bool, bool, dict[str, Any]]:
        obs, reward, terminated, truncated, info = self._env.step(action)
        self._recorder.add(float(reward), info)
        self._observations.append(_kept(obs))
        self._actions.append(action)
        self._rewards.append(float(reward))
        self._objects.append(info.get("objects", ()))
        return terminated, truncated, info

    def _as_replay(self, *, is_terminal: bool) -> ReplayEpisode:
        depth = np.stack([o["depth"] for o in self._observations]) if self._with_depth else None
        return ReplayEpisode(
            rgb=np.stack([o["rgb"] for o in self._observations]),
            depth_mm=None if depth is None else to_millimetres(depth),
            task=np.stack([o["task"] for o in self._observations]),
            action=np.stack(self._actions),
            reward=np.array(self._rewards, dtype=np.float32),
            objects=self._objects if self._with_objects else None,
            is_terminal=is_terminal,
            features=self._stack_features(),
        )

    def _stack_features(self) -> dict[str, np.ndarray]:
        if "features" not in self._observations[0]:
            return {}
        return {"features": np.stack([o["features"] for o in self._observations]).astype(np.float16)}


def _kept(obs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A copy: an environment may draw every frame into the same array."""
    return {name: np.array(value) for name, value in obs.items()}
