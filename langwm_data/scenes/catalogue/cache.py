"""Models made ready once: loaded, thinned and stored, found again by what they were made from.

A cache folder holds ``<sha256>.npz`` (see ``store``) and, for every model made ready, ``<key>.json`` with the
name of its mesh. The key covers the catalogue's bytes, the model's record and everything here that has a
say, so that nothing stale is ever found. Any number of processes may share a folder.
"""

import hashlib
import json
import logging
import math
from functools import lru_cache
from pathlib import Path

from langwm_data import atomic
from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.catalogue.loading import load_mesh
from langwm_data.scenes.meshes.decimate import decimate
from langwm_data.scenes.meshes.store import read_mesh, write_mesh
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.scenes.spec import Vec3

RECIPE = 1
"""Number of the way in which meshes are made; a new one makes all of them again."""
MAX_ERROR_M = 0.005
"""How far thinning may move a surface: less than a pixel of 128 lines beyond 0.8 m."""
MAX_ERROR_SHARE = 0.01
"""The same for small things, as a share of their diagonal."""
HEAVY_TRIANGLES = 500
"""Lighter meshes stay as they are."""

_logger = logging.getLogger(__name__)


def max_error_m(size: Vec3) -> float:
    """How far thinning may move the surface of a model of this size."""
    return min(MAX_ERROR_M, MAX_ERROR_SHARE * math.hypot(*size))


def ready_mesh(model: CatalogueModel, folder: Path) -> tuple[str, TriangleMesh]:
    """The mesh of a model as scenes use it, and its name in the cache ``folder``.

    Raises:
        ValueError: If the model cannot be read.
    """
    note = folder / f"{_key(model)}.json"
    if note.exists():
        try:
            name = json.loads(note.read_bytes())["mesh"]
            return name, read_mesh(folder, name)
        except (ValueError, KeyError, TypeError, FileNotFoundError) as error:
            _logger.warning("made again, as the cache is damaged: %s", error)
    mesh = load_mesh(model)
    if len(mesh.triangles) >= HEAVY_TRIANGLES:
        mesh = decimate(mesh, max_error_m(model.size))
    name = write_mesh(folder, mesh)
    atomic.write_json(note, {"mesh": name, "model": model.id, "recipe": RECIPE})
    return name, mesh


def _key(model: CatalogueModel) -> str:
    status = model.archive.stat()
    record = [
        _archive_digest(model.archive, status.st_size, status.st_mtime_ns),
        model.path,
        model.size,
        model.rotation,
        [RECIPE, MAX_ERROR_M, MAX_ERROR_SHARE, HEAVY_TRIANGLES],
    ]
    return hashlib.sha256(json.dumps(record).encode()).hexdigest()


@lru_cache(maxsize=64)
def _archive_digest(path: Path, size: int, mtime_ns: int) -> str:
    """SHA-256 of a file, once for as long as its size and date stay as they are."""
    del size, mtime_ns
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
