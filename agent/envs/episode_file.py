"""Fixed episodes in a file: made once, handed on, and played by every method.

Owns the form of the file and what is checked when it comes back. The file is JSON; its checksum goes into
the summary of every evaluation, so that numbers of the same episodes can be told from others.
"""

import dataclasses
import hashlib
import json
import math
from collections import Counter
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import from_json, to_jsonable_python

from agent.config import EnvConfig
from agent.envs.episodes import EPISODES_VERSION, Episode, first_fault, fixed_episodes
from agent.envs.sites import load_scene
from langwm_data import atomic
from langwm_data.baking import open_scenes
from langwm_data.config import RobotConfig
from langwm_data.scenes.spec import SceneSpec, Split

FORMAT = "langwm-episodes"
LARGEST_BYTES = 64 * 2**20
"""About two hundred thousand episodes; a file that is larger is none of ours."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EpisodeSet:
    """The fixed episodes of one split, and what they were made for."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid", allow_inf_nan=False)

    format: Literal["langwm-episodes"] = FORMAT
    version: int = EPISODES_VERSION
    split: Split
    distance_edges_m: tuple[float, ...]
    """Edges of the tiers."""
    robot: RobotConfig
    """For whom places are free and ways are short."""
    scenes: Mapping[str, str]
    """SHA-256 of every scene's description, by its name."""
    episodes: tuple[Episode, ...]
    """Scene by scene."""

    @cached_property
    def sha256(self) -> str:
        """Of all that is in the set, whatever the file's layout."""
        return hashlib.sha256(_canonical(self._values())).hexdigest()

    def _values(self) -> dict[str, Any]:
        names = [field.name for field in dataclasses.fields(self)]
        return {name: to_jsonable_python(getattr(self, name)) for name in names}

    def counts(self) -> dict[str, int]:
        """Episodes in each scene."""
        return dict(Counter(episode.scene for episode in self.episodes))

    def first(self, per_scene: int) -> "EpisodeSet":
        """The first episodes of every scene.

        Raises:
            ValueError: If a scene has fewer.
        """
        for scene, count in self.counts().items():
            if count < per_scene:
                raise ValueError(f"{per_scene} episodes on {scene} are wanted; there are {count}")
        taken: Counter[str] = Counter()
        kept = []
        for episode in self.episodes:
            taken[episode.scene] += 1
            if taken[episode.scene] <= per_scene:
                kept.append(episode)
        return dataclasses.replace(self, episodes=tuple(kept))


def make_episode_set(config: EnvConfig, split: Split, per_scene: int) -> EpisodeSet:
    """The fixed episodes of every floor of a split; 500 on a floor take a few seconds.

    Raises:
        ValueError: If a scene is too small for every tier, or cannot be loaded.
    """
    specs = [load_scene(name, config) for name in open_scenes(config.scenes).names(split)]
    return EpisodeSet(
        split=split,
        distance_edges_m=config.distance_edges_m,
        robot=config.robot,
        scenes={scene.name: digest_of(scene) for scene in specs},
        episodes=tuple(fixed_episodes(config, split, per_scene, specs)),
    )


def write_episode_file(path: Path, episodes: EpisodeSet) -> None:
    """Write a set as JSON, an episode a line; the same set always gives the same bytes."""
    head = episodes._values()
    lines = ",\n".join(json.dumps(episode) for episode in head.pop("episodes"))
    text = json.dumps(head | {"sha256": episodes.sha256}, indent=1).removesuffix("\n}")
    atomic.write_text(path, f'{text},\n "episodes": [\n{lines}\n]}}\n')


def read_episode_file(path: Path) -> EpisodeSet:
    """Read and check what ``write_episode_file`` wrote.

    Raises:
        ValueError: If there is no such file, or it is damaged, of another version or nothing of the kind.
    """
    values, data = _read_json(path)
    if values.get("format") != FORMAT:
        raise ValueError(f"{path} holds no episodes of this program")
    if values.get("version") != EPISODES_VERSION:
        raise ValueError(
            f"{path} holds episodes of version {values.get('version')!r};"
            f" this program reads {EPISODES_VERSION}"
        )
    try:
        stored = _ADAPTER.validate_json(data)
    except ValidationError as error:
        raise ValueError(f"{path} is damaged: {first_fault(error)}") from error
    episodes = EpisodeSet(**{f.name: getattr(stored, f.name) for f in dataclasses.fields(EpisodeSet)})
    if stored.sha256 != episodes.sha256:
        raise ValueError(f"{path} is damaged: its episodes are not those that its sha256 was taken of")
    _check_episodes(path, episodes)
    return episodes


def check_fits(episodes: EpisodeSet, config: EnvConfig, split: Split, place: Path) -> None:
    """Refuse episodes that were made for something else than they are to be played in.

    Args:
        episodes: What ``place`` holds.
        config: The environment.
        split: Whose scenes.
        place: Named in the message.

    Raises:
        ValueError: If split, robot, tiers or a scene differ.
    """
    if episodes.split != split:
        raise ValueError(f"{place} holds episodes of {episodes.split} floors; --split {split} was asked for")
    if episodes.robot != config.robot:
        raise ValueError(f"{place} was made for {episodes.robot}; this environment has {config.robot}")
    if episodes.distance_edges_m != config.distance_edges_m:
        raise ValueError(
            f"{place} has distances {_listed(episodes.distance_edges_m)} m between its tiers;"
            f" this environment has {_listed(config.distance_edges_m)}"
        )
    known = open_scenes(config.scenes).names(split)
    for name, digest in episodes.scenes.items():
        if name not in known:
            raise ValueError(f"{place} has episodes in scene {name!r}; this environment has {_listed(known)}")
        if digest_of(load_scene(name, config)) != digest:
            raise ValueError(f"{place} was made for another scene {name!r} than this environment has")


def digest_of(scene: SceneSpec) -> str:
    """SHA-256 of a scene's description."""
    return hashlib.sha256(scene.to_json().encode()).hexdigest()


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Stored(EpisodeSet):
    """The set as it stands in a file."""

    sha256: str  # pyright: ignore[reportIncompatibleVariableOverride]


_ADAPTER = TypeAdapter(_Stored)


def _read_json(path: Path) -> tuple[dict[str, Any], bytes]:
    if not path.is_file():
        raise ValueError(f"there is no file of episodes at {str(path)!r}")
    if (size := path.stat().st_size) > LARGEST_BYTES:
        raise ValueError(f"{path} has {size} bytes; allowed: {LARGEST_BYTES} or fewer")
    data = path.read_bytes()
    try:
        values = from_json(data, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds no episodes of this program")
    return values, data


def _check_episodes(path: Path, episodes: EpisodeSet) -> None:
    edges = episodes.distance_edges_m
    if not episodes.episodes:
        raise ValueError(f"{path} holds no episodes")
    for number, episode in enumerate(episodes.episodes):
        if episode.version != episodes.version or episode.scene not in episodes.scenes:
            raise ValueError(f"{path}: episode {number} is of another version or scene than the file")
        low, high = [*edges, math.inf, math.inf][episode.tier : episode.tier + 2] or (math.inf, math.inf)
        if not low <= episode.geodesic_distance < high:
            raise ValueError(
                f"{path}: episode {number} of {episode.geodesic_distance:g} m"
                f" does not lie in tier {episode.tier}"
            )


def _canonical(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, separators=(",", ":"), sort_keys=True, allow_nan=False).encode()


def _listed(values: tuple[Any, ...]) -> str:
    return ", ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in values)
