"""iGibson's materials: which pictures there are of each class, and which classes a group of meshes may wear.

Source: iGibson 1.0 mesh_renderer/materials.py, articulated_object.py (the form of both files, what stands in
for classes that were never made).
"""

import json
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from langwm_data import atomic
from langwm_data.scenes.assets import Assets
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.meshes.images import texture_png
from langwm_data.scenes.spec import MaterialRef, Split
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS, is_picture_for

MATERIALS_FILE = "materials/materials.json"
RECIPE = 1
"""Number of the way in which pictures are made; a new one makes all of them again."""
SPLITS: tuple[Split, ...] = ("train", "test")

_STAND_INS: Mapping[str, str] = MappingProxyType(
    {
        "rock": "rocks",
        "fence": "wood",
        "": "wood",
        "flower": "moss",
        "leaf": "moss",
        "cork": "chipboard",
        "mirror": "metal",
        "glass": "metal",
        "screen": "metal",
        "painting": "paper",
        "picture": "paper",
    }
)


class Materials:
    """The classes of ``materials.json`` with the picture of each instance."""

    def __init__(self, data: DataFolder) -> None:
        """Read which there are.

        Raises:
            ValueError: If the file is missing or damaged, or a texture that Table 5 holds out is not there.
        """
        self._data = data
        self._files = _read_classes(data)
        missing = [
            f"{category}/{number:02d}"
            for category, numbers in HELD_OUT_TEXTURE_IDS.items()
            for number in numbers
            if number not in self._files.get(category, {})
        ]
        if missing:
            raise ValueError(
                f"{MATERIALS_FILE}: {len(missing)} of the textures that Table 5 holds out for test are not in"
                f" it: {', '.join(missing[:10])}{', ...' if len(missing) > 10 else ''}"
            )

    def check(self, category: str, label: str) -> None:
        """Refuse a class that either split could show nothing of.

        Raises:
            ValueError: If the class is not there, or all of it is held out.
        """
        if category not in self._files:
            raise ValueError(f"{label}: material class {category[:60]!r} is not in {MATERIALS_FILE}")
        for split in SPLITS:
            if not any(is_picture_for(category, number, split) for number in self._files[category]):
                raise ValueError(f"{MATERIALS_FILE}: class {category!r} has no texture for the {split} split")

    def pictures(self, categories: Iterable[str], assets: Assets) -> tuple[MaterialRef, ...]:
        """All instances of some classes, their pictures among the assets.

        Raises:
            ValueError: If a picture is missing or damaged.
        """
        return tuple(
            MaterialRef(category=category, id=number, picture=_picture(self._data, path, assets))
            for category in sorted(set(categories))
            for number, path in sorted(self._files[category].items())
        )


def read_groups(data: DataFolder, path: str) -> dict[str, tuple[str, tuple[str, ...]]]:
    """For each visual mesh of a model, by its file's name: its material group and the classes of that.

    Raises:
        ValueError: If the file is missing or has another form.
    """
    content = data.read_json(path)
    if not (isinstance(content, list) and len(content) == 2 and all(isinstance(c, dict) for c in content)):
        raise ValueError(f"{path}: not of the form [{{group: [classes]}}, {{mesh: group}}]")
    classes = {str(group): _classes(names, path) for group, names in content[0].items()}
    groups = {}
    for mesh, group in content[1].items():
        if str(group) not in classes:
            raise ValueError(f"{path}: mesh {mesh[:100]!r} is of group {group!r}, which has no classes")
        groups[mesh] = (str(group), classes[str(group)])
    return groups


def _classes(names: Any, path: str) -> tuple[str, ...]:  # noqa: ANN401
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError(f"{path}: a group's classes are {str(names)[:60]}; allowed: a list of names")
    return tuple(dict.fromkeys(_STAND_INS.get(name, name) for name in names))


def _read_classes(data: DataFolder) -> dict[str, dict[int, str]]:
    """Path of the picture by class and number."""
    content = data.read_json(MATERIALS_FILE)
    classes: dict[str, dict[int, str]] = {}
    try:
        for category, instances in content.items():
            classes[category] = {}
            for key, channels in instances.items():
                number, diffuse = _number(key), channels["diffuse"]
                if number in classes[category]:
                    raise ValueError(f"{MATERIALS_FILE}: class {category!r} has the number {number} twice")
                if not isinstance(diffuse, str):
                    raise ValueError(f"{MATERIALS_FILE}: {category}/{key[:60]} has no diffuse picture")
                classes[category][number] = data.beside(MATERIALS_FILE, diffuse)
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(
            f"{MATERIALS_FILE}: not of the form {{class: {{instance: {{diffuse: path}}}}}}: {error}"
        ) from error
    return classes


def _number(key: str) -> int:
    match = re.search(r"[0-9]{1,6}$", key)
    if match is None:
        raise ValueError(f"{MATERIALS_FILE}: instance {key[:60]!r} does not end in a number")
    return int(match[0])


def _picture(data: DataFolder, path: str, assets: Assets) -> str:
    """The name of a picture among the assets; one that was made before is found by what it was made from."""
    note = assets.folders[0] / "pictures" / f"{data.digest(path)}-{RECIPE}.json"
    try:
        name = json.loads(note.read_bytes())["picture"]
        assets.read(f"{name}.png")
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        name = assets.add_picture(texture_png(data.read(path), path))
        atomic.write_json(note, {"picture": name})
    return name
