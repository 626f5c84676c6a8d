"""The fifteen floors of iGibson 1.0 as a source of scenes.

What a copy lacks is named: a floor of Table 4 whose folder is not there is left out with a warning, and a
split of which no floor is there, or a texture of Table 5 that is not there, is refused.
"""

import logging
from collections.abc import Mapping
from pathlib import Path

from langwm_data.config_io import ConfigError
from langwm_data.scenes.assets import Assets, cache_folder
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.materials import Materials
from langwm_data.scenes.igibson.scene import Copy, make_scene
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.scenes.splits import IGIBSON_BUILDINGS, split_of_scene

ROOM_KINDS_FILE = "metadata/room_categories.txt"
FOLDERS = ("scenes", "objects", "materials", "metadata")

_logger = logging.getLogger(__name__)


def folder_of(name: str) -> str:
    """Where its files lie: ``Ihlen_1`` in ``scenes/Ihlen_1_int``, but ``Rs_0`` in ``scenes/Rs_int``."""
    return "scenes/Rs_int" if name == "Rs_0" else f"scenes/{name}_int"


class IGibson:
    """Somebody's copy of the dataset; ``is_at_rest``, so nothing in it is settled."""

    is_at_rest = True

    def __init__(self, folder: Path, seed: int) -> None:
        """Look what is there.

        Args:
            folder: Holds ``scenes``, ``objects``, ``materials`` and ``metadata``.
            seed: Draws models where a scene leaves them open, and the first palette of each floor.

        Raises:
            ConfigError: If that is no copy of the dataset, or what Tables 4 and 5 need is not in it.
        """
        self._folder = folder
        data = DataFolder(folder)
        missing = [name for name in FOLDERS if not data.has_folder(name)]
        if missing:
            raise self._refused(f"has no folder {missing[0]!r}", f"a folder with {', '.join(FOLDERS)}")
        self._names = tuple(name for name in _floors() if data.has_folder(folder_of(name)))
        if not self._names:
            raise self._refused(
                "has none of the fifteen floors of Table 4", "a copy with scenes/Rs_int and others"
            )
        absent = [name for name in _floors() if name not in self._names]
        if absent:
            _logger.warning("%s lacks floors of Table 4: %s", folder, ", ".join(map(folder_of, absent)))
        try:
            self._copy = Copy(
                data=data,
                materials=Materials(data),
                room_kinds=tuple(data.read_lines(ROOM_KINDS_FILE)),
                assets=Assets(cache_folder() / "igibson"),
                seed=seed,
            )
            self.identity: Mapping[str, str] = {"igibson": data.identity}
        except ValueError as error:
            raise self._refused(
                f"cannot be used: {error}", "a whole copy of the iGibson 1.0 dataset"
            ) from error
        self.assets = self._copy.assets

    def names(self, split: Split | None = None) -> tuple[str, ...]:
        """Names of all floors that are there, or of those of one split.

        Raises:
            ConfigError: If there is none.
        """
        names = tuple(n for n in self._names if split in (None, split_of_scene(n, IGIBSON_BUILDINGS)))
        if not names:
            wanted = [n for n in _floors() if split_of_scene(n, IGIBSON_BUILDINGS) == split]
            raise self._refused(
                f"has no floor of the {split} split", f"a copy with {' or '.join(map(folder_of, wanted))}"
            )
        return names

    def make(self, name: str) -> SceneSpec:
        """One floor, at rest as its makers left it, its doors open.

        Raises:
            ValueError: If it is not there, or what it is made from is missing or damaged.
        """
        split_of_scene(name, IGIBSON_BUILDINGS)
        if name not in self._names:
            raise self._refused(f"has no folder {folder_of(name)!r}", f"scenes {', '.join(self._names)}")
        try:
            return make_scene(self._copy, name, folder_of(name))
        except ValueError as error:
            raise self._refused(
                f"cannot give scene {name}: {error}", "a whole copy of the iGibson 1.0 dataset"
            ) from error

    def _refused(self, what: str, allowed: str) -> ConfigError:
        return ConfigError(f"field 'scenes.igibson': value {str(self._folder)!r} {what}; allowed: {allowed}")


def _floors() -> list[str]:
    """In the order of Table 4."""
    return [f"{name}_{i}" for name, building in IGIBSON_BUILDINGS.items() for i in range(building.floors)]
