"""Meshes and pictures that scenes name by their content: one folder, ``<sha256>.npz`` and ``<sha256>.png``.

The same name means the same bytes in every folder, so files can be copied from one to another, and what is
read is compared with its name. Scenes that are procedural throughout need none.
"""

import hashlib
import os
import re
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from langwm_data import atomic
from langwm_data.scenes.meshes.images import image_size, square_picture
from langwm_data.scenes.meshes.store import MAX_FILE_BYTES, read_mesh, write_mesh
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.scenes.spec import SceneSpec

ASSETS_DIR = "assets"
ASSET_PATTERN = r"[0-9a-f]{64}\.(npz|png)"
MAX_PICTURE_SIDE = 512


class Assets:
    """The meshes and pictures of some folders; what is added goes into the first."""

    def __init__(self, *folders: Path) -> None:
        self.folders = folders

    def mesh(self, name: str) -> TriangleMesh:
        """The mesh called ``name``, read once.

        Raises:
            ValueError: If there is none, or its file is not what the name says.
        """
        return _mesh(self._find(f"{name}.npz").parent, name)

    def picture(self, name: str, size_px: int) -> NDArray[np.uint8]:
        """The picture called ``name`` as a square (size_px, size_px, 3).

        Raises:
            ValueError: If there is none, or its file is not what the name says.
        """
        label = f"{name}.png"
        data = self.read(label)
        if max(image_size(data, label)) > MAX_PICTURE_SIDE:
            raise ValueError(f"{label}: a picture with a side of more than {MAX_PICTURE_SIDE} pixels")
        return square_picture(data, size_px, label)

    def read(self, file: str) -> bytes:
        """The bytes of ``<sha256>.npz`` or ``<sha256>.png``.

        Raises:
            ValueError: If there is no such file, or it is not what the name says.
        """
        path = self._find(file)
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ValueError(
                f"asset {path} has {path.stat().st_size} bytes; at most {MAX_FILE_BYTES} are read"
            )
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() != path.stem:
            raise ValueError(f"asset {path}: its content does not match its name")
        return data

    def add_picture(self, png: bytes) -> str:
        """Keep a PNG; its name."""
        name = hashlib.sha256(png).hexdigest()
        path = self.folders[0] / f"{name}.png"
        if not path.is_file():
            atomic.write_bytes(path, png)
        return name

    def add_mesh(self, mesh: TriangleMesh) -> str:
        """Keep a mesh; its name."""
        return write_mesh(self.folders[0], mesh)

    def copy_to(self, folder: Path, scene: SceneSpec) -> None:
        """Have all that ``scene`` needs in another folder as well."""
        for file in scene.assets():
            if not (folder / file).is_file():
                atomic.write_bytes(folder / file, self.read(file))

    def _find(self, file: str) -> Path:
        if not re.fullmatch(ASSET_PATTERN, file):
            raise ValueError(
                f"{file!r} is no name of an asset; names are 64 hexadecimal digits with .npz or .png"
            )
        for folder in self.folders:
            if (folder / file).is_file():
                return folder / file
        where = ", ".join(map(str, self.folders)) or "nowhere"
        raise ValueError(f"asset {file} is missing; looked for in: {where}")


NO_ASSETS = Assets()


def cache_folder() -> Path:
    """Where prepared meshes and pictures are kept between runs: ``XDG_CACHE_HOME`` or ``~/.cache``."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "langwm"


@lru_cache(maxsize=1024)
def _mesh(folder: Path, name: str) -> TriangleMesh:
    return read_mesh(folder, name)
