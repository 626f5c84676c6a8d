"""Textures that were drawn once, for all processes and later runs of this machine.

A file holds the SHA-256 of a picture and its pixels. Folders are named after everything here that has a say
in how textures look, so nothing stale is ever found. What is damaged, or cannot be kept, is drawn again.
"""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from langwm_data import atomic
from langwm_data.scenes.assets import cache_folder

TEXTURES_DIR = "textures"
_RECIPES = ("textures.py", "texture_recipes.py", "patterns.py", "../seeding.py")
_DIGEST_BYTES = hashlib.sha256().digest_size

Picture = NDArray[np.uint8]

_log = logging.getLogger(__name__)


def kept_picture(name: str, size_px: int, draw: Callable[[], Picture]) -> Picture:
    """The picture (size_px, size_px, 3) called ``name``, not writable; ``draw`` makes what is not kept."""
    path = cache_folder() / TEXTURES_DIR / _recipes_digest() / f"{name}-{size_px}"
    shape = (size_px, size_px, 3)
    pixels = _read(path, size_px * size_px * 3)
    if pixels is None:
        pixels = draw().tobytes()
        _keep(path, pixels)
    return np.frombuffer(pixels, np.uint8).reshape(shape)


def _read(path: Path, size: int) -> bytes | None:
    """The pixels in a file, ``size`` bytes, if it is there and undamaged."""
    try:
        with path.open("rb") as file:
            digest, pixels = file.read(_DIGEST_BYTES), file.read(size + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        _log.debug("%s cannot be read: %s", path, error)
        return None
    return pixels if len(pixels) == size and hashlib.sha256(pixels).digest() == digest else None


def _keep(path: Path, pixels: bytes) -> None:
    try:
        # Whether it survives a power cut does not matter: what is read is compared with its checksum.
        atomic.write_bytes(path, hashlib.sha256(pixels).digest() + pixels, is_durable=False)
    except OSError as error:
        _log.debug("%s is not kept: %s", path, error)


@cache
def _recipes_digest() -> str:
    """Of the recipes and of the libraries that they use."""
    digest = hashlib.sha256()
    for name in _RECIPES:
        digest.update((Path(__file__).parent / name).read_bytes())
    digest.update(f"{version('numpy')} {version('scipy')}".encode())
    return digest.hexdigest()[:16]
