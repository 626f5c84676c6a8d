"""The baked scenes of a dataset: where each lies, and how it is written and read."""

import re
from pathlib import Path

from langwm_data import atomic
from langwm_data.scenes.spec import ModelRecord, SceneSpec
from langwm_data.shards.manifest import Manifest
from langwm_data.shards.sample import DatasetError

SCENES_DIR = "scenes"
_NAME_PATTERN = r"[A-Za-z0-9_]+"


def scene_file(name: str) -> str:
    """Where the scene called ``name`` lies, relative to its dataset.

    Raises:
        DatasetError: If the name could lead out of the folder.
    """
    if not re.fullmatch(_NAME_PATTERN, name):
        raise DatasetError(f"scene name {name!r} is not allowed; allowed: letters, digits and underscores")
    return f"{SCENES_DIR}/{name}.json"


def scene_path(folder: Path, name: str) -> Path:
    """Where the scene called ``name`` lies in the dataset ``folder``.

    Raises:
        DatasetError: If the name could lead out of the folder.
    """
    return folder / scene_file(name)


def write_scene(folder: Path, scene: SceneSpec) -> None:
    """Write a scene under its name."""
    atomic.write_text(scene_path(folder, scene.name), scene.to_json())


def read_scene(folder: Path, name: str) -> SceneSpec:
    """The scene called ``name``.

    Raises:
        DatasetError: If its file is missing or damaged, or holds another scene.
    """
    path = scene_path(folder, name)
    try:
        scene = SceneSpec.from_json(path.read_bytes())
    except FileNotFoundError as error:
        raise DatasetError(f"scene {path} is missing") from error
    except ValueError as error:
        raise DatasetError(f"{path}: {error}") from error
    if scene.name != name:
        raise DatasetError(f"{path} holds scene {scene.name!r}; it should hold {name!r}")
    return scene


def read_models(folder: Path, manifest: Manifest) -> tuple[ModelRecord, ...]:
    """The models of others that stand in the scenes of a dataset, each once, sorted by name.

    Where the manifest names no files of others there are none, and no scene is read.

    Raises:
        DatasetError: If the file of a scene is missing or damaged.
    """
    if not manifest.sources:
        return ()
    names = sorted({name for record in manifest.splits.values() for name in record.scenes})
    records = {record for name in names for record in read_scene(folder, name).models}
    return tuple(sorted(records, key=lambda r: (r.model, r.split)))
