"""Models made ready once: loaded, thinned, given solids, and stored; found again by what they were made from.

A cache folder holds ``<sha256>.npz`` (see ``store``) and, for every model made ready, ``<key>.json`` with the
name of its mesh and what homes need to know of it. The key covers the catalogue's bytes, the model's record
and everything here that has a say, so that nothing stale is ever found. Any number of processes may share a
folder.
"""

import dataclasses
import hashlib
import json
import logging
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import ConfigDict, TypeAdapter

from langwm_data import atomic
from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.catalogue.loading import load_mesh
from langwm_data.scenes.meshes.decimate import decimate
from langwm_data.scenes.meshes.pieces import Pieces, cut
from langwm_data.scenes.meshes.solids import hugging_boxes
from langwm_data.scenes.meshes.store import read_mesh, write_mesh
from langwm_data.scenes.meshes.tops import Top, level_top
from langwm_data.scenes.meshes.triangles import TriangleMesh
from langwm_data.scenes.spec import Vec3

RECIPE = 2
"""Number of the way in which meshes and solids are made; a new one makes all of them again."""
MAX_ERROR_M = 0.005
"""How far thinning may move a surface: less than a pixel of 128 lines beyond 0.8 m."""
MAX_ERROR_SHARE = 0.01
"""The same for small things, as a share of their diagonal."""
HEAVY_TRIANGLES = 500
"""Lighter meshes stay as they are."""
ENOUGH_TRIANGLES = 5_000
"""A mesh that keeps more is thinned anew with a larger error: a floor of a home shows some fifty models."""
FACTORS = (1, 2, 4)
"""Multiples of the error that are tried in turn."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ReadyModel:
    """What homes need to know of a model whose mesh lies in the cache."""

    mesh: str
    num_groups: int
    num_triangles: int
    solids: tuple[tuple[Vec3, Vec3], ...]
    """Lowest and highest corners of boxes, metres, in the frame of the mesh."""
    top: Top | None
    cut_out_share: float
    """How much of its surface is cut out of its textures."""


ReadyModel.__pydantic_config__ = ConfigDict(extra="forbid")  # pyright: ignore[reportAttributeAccessIssue]
_ADAPTER = TypeAdapter(ReadyModel)


def max_error_m(size: Vec3) -> float:
    """How far thinning may move the surface of a model of this size."""
    return min(MAX_ERROR_M, MAX_ERROR_SHARE * math.hypot(*size))


def make_ready(model: CatalogueModel, folder: Path) -> ReadyModel:
    """A model as scenes use it, its mesh in the cache ``folder``.

    Raises:
        ValueError: If the model cannot be read.
    """
    note = _note(model, folder)
    if note.exists():
        try:
            ready = _ADAPTER.validate_json(note.read_bytes())
            read_mesh(folder, ready.mesh)
            return ready
        except (ValueError, FileNotFoundError) as error:
            _logger.warning("made again, as the cache is damaged: %s", error)
    mesh = load_mesh(model)
    if len(mesh.triangles) >= HEAVY_TRIANGLES:
        mesh = _thinned(mesh, max_error_m(model.size))
    ready = _described(mesh, write_mesh(folder, mesh))
    atomic.write_json(note, dataclasses.asdict(ready))
    return ready


def is_ready(model: CatalogueModel, folder: Path) -> bool:
    """Whether a model has been made ready before."""
    return _note(model, folder).exists()


def _thinned(mesh: TriangleMesh, error_m: float) -> TriangleMesh:
    thin = mesh
    for factor in FACTORS:
        thin = decimate(mesh, factor * error_m)
        if len(thin.triangles) <= ENOUGH_TRIANGLES:
            break
    return thin


def archive_digest(path: Path) -> str:
    """SHA-256 of a catalogue's file."""
    status = path.stat()
    return _digest(path, status.st_size, status.st_mtime_ns)


def _described(mesh: TriangleMesh, name: str) -> ReadyModel:
    pieces = cut(mesh)
    top = level_top(pieces)
    boxes = hugging_boxes(pieces, None if top is None else top[0])
    solids: Any = tuple((tuple(low), tuple(high)) for low, high in boxes.round(5).tolist())
    return ReadyModel(
        mesh=name,
        num_groups=len(mesh.sizes),
        num_triangles=len(mesh.triangles),
        solids=solids,
        top=top,
        cut_out_share=round(_cut_out_share(mesh, pieces), 4),
    )


def _cut_out_share(mesh: TriangleMesh, pieces: Pieces) -> float:
    """How much of the surface has a texture that is more clear than solid there."""
    clear_m2 = 0.0
    for group, material in enumerate(mesh.materials):
        if material.texture is None:
            continue
        image = cv2.imdecode(np.frombuffer(material.texture, np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None
        if image.ndim < 3 or image.shape[2] < 4:
            continue
        is_here = pieces.groups == group
        height, width = image.shape[:2]
        column = np.floor(pieces.uvs[is_here, 0] * width).astype(np.int64) % width
        row = (height - 1 - np.floor(pieces.uvs[is_here, 1] * height).astype(np.int64)) % height
        clear_m2 += float(pieces.areas[is_here][image[row, column, 3] < 128].sum())
    return clear_m2 / float(pieces.areas.sum())


def _note(model: CatalogueModel, folder: Path) -> Path:
    record = [
        archive_digest(model.archive),
        model.path,
        model.size,
        model.rotation,
        [RECIPE, MAX_ERROR_M, MAX_ERROR_SHARE, HEAVY_TRIANGLES, ENOUGH_TRIANGLES, FACTORS],
    ]
    return folder / f"{hashlib.sha256(json.dumps(record).encode()).hexdigest()}.json"


@lru_cache(maxsize=64)
def _digest(path: Path, size: int, mtime_ns: int) -> str:
    """SHA-256 of a file, once for as long as its size and date stay as they are."""
    del size, mtime_ns
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
