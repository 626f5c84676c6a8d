"""What an episode is, how one is drawn, and the fixed ones that every method is evaluated on."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from agent.config import EnvConfig
from agent.envs.sites import Site, load_scene
from langwm_data.baking import open_scenes
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.seeding import make_rng

EPISODES_VERSION = 3
"""Raised whenever the fixed episodes of a seed change, so that results are not compared across."""
GOALS_TRIED = 100
STARTS_TRIED = 20
"""Per goal."""

_log = logging.getLogger(__name__)


class SceneTooSmallError(ValueError):
    """A scene in which no two places seem to lie as far apart as an episode asks for."""


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One task: where to start, where to go, what the place looks like."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid", allow_inf_nan=False)

    version: int = EPISODES_VERSION
    scene: str
    start_xy: tuple[float, float]
    """Metres, world frame."""
    start_yaw: float
    """Radians, counter-clockwise from +x."""
    goal_xy: tuple[float, float]
    palette_seed: Annotated[int, Field(ge=0)]
    """Seed of the textures, and of the lights where these are drawn."""
    geodesic_distance: Annotated[float, Field(gt=0)]
    """Length in metres of the shortest way for the robot from start to goal."""
    tier: Annotated[int, Field(ge=0)]
    """Which of ``EnvConfig.distance_edges_m`` the distance lies between, from 0."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; numbers come back exactly."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Episode":
        """Read back ``to_dict``.

        Raises:
            ValueError: If the episode is of another version or a field is missing, unknown or impossible.
        """
        if values.get("version") != EPISODES_VERSION:
            raise ValueError(
                f"episode has version {values.get('version')!r}; this program reads {EPISODES_VERSION}"
            )
        try:
            return _ADAPTER.validate_python(dict(values))
        except ValidationError as error:
            raise ValueError(f"not an episode: {first_fault(error)}") from error


_ADAPTER = TypeAdapter(Episode)


def first_fault(error: ValidationError) -> str:
    """Where a document is wrong first, and how."""
    fault = error.errors()[0]
    return f"{'.'.join(str(part) for part in fault['loc']) or 'the document'}: {fault['msg']}"


def sample_episode(
    rng: np.random.Generator, site: Site, config: EnvConfig, *, tier: int | None = None
) -> Episode:
    """Draw an episode in ``site``.

    The goal is uniform over the free space, the start uniform over what lies within the wanted geodesic
    distance of it, the yaw uniform. Both poses are free of contact.

    Args:
        rng: Source of all that is drawn, the texture seed included.
        site: The scene, ready to drive in.
        config: Gives the edges of the distance tiers.
        tier: Stay within this tier; any distance within ``config.drawn_tiers`` when None.

    Raises:
        SceneTooSmallError: If the scene seems to have no such pair of places.
    """
    edges = config.distance_edges_m
    drawn = edges[0], edges[-1 if config.drawn_tiers is None else config.drawn_tiers]
    low, high = drawn if tier is None else edges[tier : tier + 2]
    for _ in range(GOALS_TRIED):
        goal = _place(rng, site)
        if not site.can_begin_at(goal):
            continue
        field = site.distance_field(goal)
        for _ in range(STARTS_TRIED):
            start, yaw = _place(rng, site), float(rng.uniform(-np.pi, np.pi))
            distance = float(field.distance(start))
            if low <= distance < high and site.can_begin_at(start):
                return Episode(
                    scene=site.scene.name,
                    start_xy=start,
                    start_yaw=yaw,
                    goal_xy=goal,
                    palette_seed=int(rng.integers(2**31)),
                    geodesic_distance=distance,
                    tier=int(np.searchsorted(edges, distance, side="right")) - 1,
                )
    raise SceneTooSmallError(
        f"scene {site.scene.name!r}: found no start and goal {low:g} to {high:g} m apart;"
        " choose other distance_edges_m"
    )


def _place(rng: np.random.Generator, site: Site) -> tuple[float, float]:
    x, y = site.free.sample(rng).tolist()
    return x, y


def fixed_episodes(
    config: EnvConfig, split: Split, per_scene: int, scenes: Iterable[SceneSpec] | None = None
) -> list[Episode]:
    """The evaluation episodes: the same list for the same ``config`` and ``split``, on any machine.

    Episode i of a scene depends on ``config.seed_eval``, the scene and i alone and lies in tier i modulo
    the number of tiers, so a shorter list is the beginning of a longer one. Where a scene is too small for
    a tier, its other tiers take turns instead, and a warning says so: every scene has as many episodes.

    Args:
        config: Scenes, robot, distances and ``seed_eval``.
        split: Whose scenes.
        per_scene: Episodes in each of them.
        scenes: These scenes instead of all homes of the split.

    Raises:
        SceneTooSmallError: If a scene is too small for every tier.
    """
    specs = (
        [load_scene(n, config) for n in open_scenes(config.scenes).names(split)]
        if scenes is None
        else list(scenes)
    )
    episodes = []
    for scene in specs:
        with Site(scene, config) as site:
            episodes += _episodes_in(site, config, split, per_scene)
    return episodes


def _episodes_in(site: Site, config: EnvConfig, split: Split, count: int) -> list[Episode]:
    """``count`` episodes of one scene, its tiers in turn; a tier that failed is not tried again."""
    tiers = list(range(len(config.distance_edges_m) - 1))
    episodes: list[Episode] = []
    while len(episodes) < count:
        i, name = len(episodes), site.scene.name
        rng = make_rng(config.seed_eval, "episode", EPISODES_VERSION, split, name, i)
        tier = tiers[i % len(tiers)]
        try:
            episodes.append(sample_episode(rng, site, config, tier=tier))
        except SceneTooSmallError as error:
            tiers.remove(tier)
            if not tiers:
                raise
            _log.warning("%s; its other distances take turns instead", str(error).partition(";")[0])
    return episodes
