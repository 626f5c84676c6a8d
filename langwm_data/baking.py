"""Homes with their loose things at rest: settled by physics, or read from a dataset that has them."""

from pathlib import Path

from langwm_data.config import ScenesConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.spec import SceneSpec
from langwm_data.scenes.splits import split_of_scene
from langwm_data.shards.manifest import GENERATOR, read_manifest
from langwm_data.shards.scenes import read_scene, scene_path
from langwm_data.sim.world import bake_home


def load_home(name: str, scenes: ScenesConfig) -> SceneSpec:
    """The home called ``name``, the same wherever it comes from.

    With ``scenes.baked`` it is read, which needs no physics engine; a floor that no frame of that dataset
    shows is settled as without it.

    Raises:
        ValueError: If there is no such home, or what ``scenes.baked`` names is no finished dataset, or one
            of another seed or generator.
    """
    split_of_scene(name)
    if scenes.baked is None:
        return bake_home(name, seed=scenes.seed)
    folder = Path(scenes.baked)
    _check_origin(folder, scenes.seed)
    if not scene_path(folder, name).is_file():
        return bake_home(name, seed=scenes.seed)
    return read_scene(folder, name)


def _check_origin(folder: Path, seed: int) -> None:
    manifest = read_manifest(folder)
    scenes = manifest.config.get("scenes")
    made_with = scenes.get("seed") if isinstance(scenes, dict) else None
    if (made_with, manifest.generator) != (seed, GENERATOR):
        raise ConfigError(
            f"field 'scenes.baked': value {str(folder)!r} holds scenes of seed {made_with} by"
            f" {manifest.generator}; allowed: a dataset of scenes.seed {seed} by {GENERATOR}"
        )
