"""The environment that a configuration asks for."""

from dataclasses import replace

import gymnasium

from agent.config import EnvConfig
from agent.envs.foreign import adapt_env, make_foreign
from agent.envs.pointnav import PointNavEnv
from langwm_data.config_io import ConfigError


def make_env(
    config: EnvConfig, env: gymnasium.Env | None = None, *, with_labels: bool = False
) -> gymnasium.Env:
    """PointGoal navigation on training floors, or ``config.id``, or ``env`` if it is given.

    Args:
        config: Of the environment; frames are resized to its camera.
        env: The caller's own.
        with_labels: Whether PointGoal navigation labels objects although ``config`` does not say so.

    Raises:
        ConfigError: If there is no such environment, or it cannot be used.
    """
    size = (config.camera.height, config.camera.width)
    if env is not None:
        return adapt_env(env, size=size, has_pixels=config.pixels)
    if config.id is not None:
        return make_foreign(config.id, config.kwargs, size=size, has_pixels=config.pixels)
    return PointNavEnv(replace(config, with_labels=config.with_labels or with_labels))


def check_gives(env: gymnasium.Env, system: str, *, labels: bool, depth: bool) -> None:
    """Refuse an environment that lacks what ``system`` needs or ``env.with_labels`` asks for.

    Raises:
        ConfigError: Naming what is missing.
    """
    space = env.observation_space
    missing = []
    if depth and not (isinstance(space, gymnasium.spaces.Dict) and "depth" in space.spaces):
        missing.append("depth in its observation")
    if labels and not isinstance(env.unwrapped, PointNavEnv) and "objects" not in env.reset(seed=0)[1]:
        missing.append("objects in its info")
    if missing:
        raise ConfigError(
            f"system {system!r} is to be given {' and '.join(missing)}, which this environment does not give;"
            " leave env.with_labels out, and use features=frozen with --mae RUN, or dreamerv2, curl or rad"
        )
