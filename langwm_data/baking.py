"""Scenes with their loose things at rest: settled by physics, or read from a dataset that has them."""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path

from langwm_data.config import ScenesConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.assets import ASSETS_DIR, NO_ASSETS, Assets
from langwm_data.scenes.homes import Homes
from langwm_data.scenes.igibson.source import IGibson
from langwm_data.scenes.source import SceneSource
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.scenes.splits import EVERYTHING, HeldOut
from langwm_data.shards.manifest import GENERATOR, Manifest, read_manifest
from langwm_data.shards.scenes import read_scene, scene_path
from langwm_data.sim.bullet import describe_physics
from langwm_data.sim.settle import settle


class SceneLibrary:
    """All floors that a config offers. Made by ``open_scenes``."""

    def __init__(self, config: ScenesConfig, holds_out: Sequence[HeldOut]) -> None:
        self._folder = None if config.baked is None else Path(config.baked)
        manifest = None if self._folder is None else read_manifest(self._folder)
        source = _source(config, manifest, holds_out)
        if self._folder is not None and manifest is not None:
            _check_origin(self._folder, manifest, config, source.identity)
            _check_held_out(self._folder, manifest, holds_out)
        self._source = source
        self.identity: Mapping[str, str] = source.identity
        """SHA-256 of the files of others that scenes are made from, by field; see ``SceneSource``."""
        self._baked_by = None if manifest is None else manifest.physics
        own = () if self._folder is None else (self._folder / ASSETS_DIR,)
        self.assets = Assets(*own, *source.assets.folders)

    def names(self, split: Split | None = None) -> tuple[str, ...]:
        """Names of all floors, or of those of one split."""
        return self._source.names(split)

    @property
    def physics(self) -> str:
        """What let the loose things of these floors come to rest, with its version.

        Raises:
            ValueError: If that is to be done on this machine, and the physics engine is not installed.
        """
        if self._baked_by is not None:
            return self._baked_by
        try:
            return describe_physics()
        except ValueError as error:
            raise ConfigError(
                f"{error}; without it, give scenes.baked, a finished dataset of these scenes"
            ) from error

    def check_whole(self) -> None:
        """Refuse to plan frames where only those floors are known that some dataset shows.

        Raises:
            ConfigError: If so: another list of floors would give other frames.
        """
        if isinstance(self._source, _OnlyBaked):
            fields = " and ".join(f"scenes.{field}" for field in self.identity)
            raise ConfigError(
                f"field 'scenes.baked': value {str(self._folder)!r} tells of no floors but those that it"
                f" shows; to render frames, give {fields} as well"
            )

    def load(self, name: str) -> SceneSpec:
        """The floor called ``name``, the same wherever it comes from; its assets are in ``assets``.

        With ``scenes.baked`` it is read, which needs no physics engine; a floor that no frame of that
        dataset shows is settled as without it.

        Raises:
            ValueError: If there is no such floor, or it is not there and would be settled by another
                physics engine than the floors that are.
        """
        if self._folder is not None and name in self.names():
            if scene_path(self._folder, name).is_file():
                return read_scene(self._folder, name)
            self._check_physics(name)
        return _bake(self._source, name)

    def _check_physics(self, name: str) -> None:
        if self.physics != (here := describe_physics()):
            raise ConfigError(
                f"field 'scenes.baked': value {str(self._folder)!r} has no scene {name!r}, and its scenes"
                f" were settled by {self.physics}; allowed: one that has it, or scenes settled by {here}"
            )


@cache
def open_scenes(config: ScenesConfig, holds_out: tuple[HeldOut, ...] = EVERYTHING) -> SceneLibrary:
    """The floors that ``config`` offers; opened once in a process.

    Args:
        config: Where they come from.
        holds_out: What floors for test do not share with those for training.

    Raises:
        ValueError: If what ``scenes.baked`` names is no finished dataset, or one of other scenes.
    """
    return SceneLibrary(config, holds_out)


class _OnlyBaked:
    """The floors of a dataset that were made from files of others, which may not be on this machine."""

    is_at_rest = True

    def __init__(self, manifest: Manifest) -> None:
        self.assets = NO_ASSETS
        self.identity: Mapping[str, str] = manifest.sources
        self._splits = {split: tuple(record.scenes) for split, record in manifest.splits.items()}

    def names(self, split: Split | None = None) -> tuple[str, ...]:
        return tuple(name for s, names in self._splits.items() if split in (None, s) for name in names)

    def make(self, name: str) -> SceneSpec:
        allowed = ", ".join(self.names())
        raise ValueError(f"scene {name!r} is not in the dataset that scenes.baked names; allowed: {allowed}")


def _source(config: ScenesConfig, baked: Manifest | None, holds_out: Sequence[HeldOut]) -> SceneSource:
    is_named = config.furniture is not None or config.igibson is not None
    if baked is not None and baked.sources and not is_named:
        return _OnlyBaked(baked)
    if config.igibson is not None:
        return IGibson(Path(config.igibson), config.seed)
    if config.furniture is None:
        return Homes(config.seed, holds_out=holds_out)
    try:
        return Homes(config.seed, Path(config.furniture), holds_out)
    except ValueError as error:
        raise ConfigError(
            f"field 'scenes.furniture': value {config.furniture!r} cannot be used: {error};"
            " allowed: a folder with Sweet Home 3D catalogues (.sh3f)"
        ) from error


@lru_cache(maxsize=64)
def _bake(source: SceneSource, name: str) -> SceneSpec:
    scene = source.make(name)
    return scene if source.is_at_rest else settle(scene)


def _check_origin(
    folder: Path, manifest: Manifest, config: ScenesConfig, identity: Mapping[str, str]
) -> None:
    scenes = manifest.config.get("scenes")
    made_with = scenes.get("seed") if isinstance(scenes, dict) else None
    if (made_with, manifest.generator) != (config.seed, GENERATOR):
        raise ConfigError(
            f"field 'scenes.baked': value {str(folder)!r} holds scenes of seed {made_with} by"
            f" {manifest.generator}; allowed: a dataset of scenes.seed {config.seed} by {GENERATOR}"
        )
    if dict(identity) != manifest.sources:
        raise ConfigError(
            f"field 'scenes.baked': value {str(folder)!r} holds scenes made from"
            f" {_listed(manifest.sources)}; allowed: a dataset of scenes made from {_listed(identity)}"
        )


def _check_held_out(folder: Path, manifest: Manifest, holds_out: Sequence[HeldOut]) -> None:
    if manifest.holds_out != tuple(holds_out):
        raise ConfigError(
            f"field 'scenes.baked': value {str(folder)!r} holds scenes of splits.holds_out"
            f" {list(manifest.holds_out)}; allowed: a dataset of splits.holds_out {list(holds_out)}"
        )


def _listed(sources: Mapping[str, str]) -> str:
    return (
        ", ".join(f"scenes.{field} {digest[:12]}" for field, digest in sources.items()) or "nothing of others"
    )
