"""Which models a folder of Sweet Home 3D catalogues (``.sh3f``) offers, without reading their meshes.

A catalogue is a zip file with ``PluginFurnitureCatalog.properties``, where ``name#7`` is the name of the
seventh model. Files of other languages (``..._fr.properties``) translate names only and are not read.
Lengths there are centimetres; width, depth and height are x, z and y of the model's own axes.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from langwm_data.scenes.catalogue.archive import open_archive
from langwm_data.scenes.catalogue.kinds import Kind, kind_of
from langwm_data.scenes.catalogue.properties import parse_properties
from langwm_data.scenes.spec import Vec3

PROPERTIES = "PluginFurnitureCatalog.properties"
MAX_MODELS = 10_000
"""In one file."""
MAX_SIZE_M = 100.0

Rotation = tuple[float, ...]
"""Nine numbers of a matrix, row by row."""
_UPRIGHT: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_ROTATION_ERROR = 1e-3


@dataclass(frozen=True, kw_only=True)
class CatalogueModel:
    """One model as its catalogue describes it."""

    id: str
    """As the catalogue writes it, such as ``Scopia#bed1``."""
    name: str
    """The catalogue's, in English."""
    group: str
    """The catalogue's own category, such as ``Living room``."""
    kind: Kind | None
    """Ours; None where nothing says what it is."""
    size: Vec3
    """Metres: width, depth and height, which are x, y and z of our furniture."""
    elevation_m: float
    """Of its lowest point above the floor."""
    rotation: Rotation
    """Turns the file's axes upright before anything else."""
    is_opening: bool
    """Whether it is a door or window, set into a wall."""
    author: str
    licence: str
    catalogue: str
    archive: Path
    path: str
    """Of the model inside of the archive."""
    checksum: tuple[int, int]
    """CRC-32 and size of that file: equal for models that are copies of each other."""


@dataclass(frozen=True, kw_only=True)
class Catalogue:
    """All models of a folder, sorted by id."""

    models: tuple[CatalogueModel, ...]
    left_out: Mapping[str, str]
    """Models that cannot be used whatever they are, and why."""

    @classmethod
    def open(cls, folder: Path) -> Self:
        """List the models of all ``.sh3f`` files in a folder and the folders in it.

        Raises:
            ValueError: If there are none, or one is damaged, hostile or no catalogue.
        """
        paths = sorted(folder.rglob("*.sh3f"))
        if not paths:
            raise ValueError(f"{folder}: no Sweet Home 3D catalogue (.sh3f) in it")
        models: dict[str, CatalogueModel] = {}
        left_out: dict[str, str] = {}
        for path in paths:
            for model in _read(path):
                if model.id in models:
                    left_out[f"{model.id} of {path.name}"] = "its id stands twice"
                elif _format(model.path) not in (".obj", ".zip"):
                    left_out[model.id] = f"it is a {_format(model.path)!r} file; only OBJ is read"
                else:
                    models[model.id] = model
        return cls(models=tuple(models[key] for key in sorted(models)), left_out=left_out)

    def known(self) -> tuple[CatalogueModel, ...]:
        """The models that have one of our categories."""
        return tuple(model for model in self.models if model.kind is not None)

    def report(self) -> str:
        """What is used as what, and by name what is not used."""
        kinds = [model.kind for model in self.models if model.kind is not None]
        counts = Counter(kind.category for kind in kinds)
        unknown = Counter((model.group, model.name) for model in self.models if model.kind is None)
        lines = [f"{len(kinds)} of {len(self.models) + len(self.left_out)} models are of a known kind"]
        lines += [f"  {category}: {count}" for category, count in sorted(counts.items())]
        lines += ["of no known kind:"] if unknown else []
        lines += [f"  {group} / {name}: {count}" for (group, name), count in sorted(unknown.items())]
        lines += ["left out:"] if self.left_out else []
        lines += [f"  {model}: {reason}" for model, reason in sorted(self.left_out.items())]
        return "\n".join(lines)


def _read(path: Path) -> list[CatalogueModel]:
    with open_archive(path) as archive:
        if PROPERTIES not in archive:
            raise ValueError(f"{path.name}: no {PROPERTIES} in it")
        pairs = parse_properties(archive.read(PROPERTIES), f"{path.name}!{PROPERTIES}")
        records = [_Record(path, pairs, number) for number in _numbers(pairs, path)]
        return [_model(record, archive.checksum(record.file())) for record in records]


def _numbers(pairs: Mapping[str, str], path: Path) -> list[int]:
    """Of all models that have a name."""
    found = (re.fullmatch(r"name#(\d{1,6})", key) for key in pairs)
    numbers = sorted(int(match[1]) for match in found if match)
    if len(numbers) > MAX_MODELS:
        raise ValueError(f"{path.name}: {len(numbers)} models; at most {MAX_MODELS} are read")
    return numbers


class _Record:
    """The properties of one model."""

    def __init__(self, path: Path, pairs: Mapping[str, str], number: int) -> None:
        self.path = path
        self._pairs = pairs
        self._number = number

    def text(self, key: str, default: str | None = None) -> str:
        value = self._pairs.get(f"{key}#{self._number}", default)
        if value is None:
            raise ValueError(f"{self.path.name}: model {self._number} has no {key!r}")
        return value.strip()

    def shared(self, key: str) -> str:
        """A property of the catalogue, or the model's own where it has one."""
        return self.text(key, self._pairs.get(key, "not stated"))

    def of_catalogue(self, key: str, default: str) -> str:
        return self._pairs.get(key, default).strip()

    def metres(self, key: str, default: str | None = None) -> float:
        text = self.text(key, default)
        value = _number(text) / 100
        is_size = default is None
        if not (value > 0 if is_size else value >= 0) or value > MAX_SIZE_M:
            limit = f"{'more than 0' if is_size else '0'} to {MAX_SIZE_M * 100:g}"
            raise self._fault(key, text, f"allowed: {limit} cm")
        return value

    def rotation(self) -> Rotation:
        text = self.text("modelRotation", " ".join(map(str, _UPRIGHT)))
        values = tuple(_number(word) for word in text.split())
        is_rotation = len(values) == 9 and all(map(math.isfinite, values))
        if is_rotation:
            matrix = np.reshape(values, (3, 3))
            is_orthogonal = np.abs(matrix @ matrix.T - np.eye(3)).max() < _ROTATION_ERROR
            is_rotation = bool(is_orthogonal and np.linalg.det(matrix) > 0)
        if not is_rotation:
            raise self._fault("modelRotation", text, "allowed: nine numbers of a rotation, row by row")
        return values

    def file(self) -> str:
        """The file in the archive; of ``outer.zip!/inner.obj`` the outer one."""
        text = self.text("model")
        if ":" in text:
            raise self._fault("model", text, "allowed: a file of the catalogue")
        return text.lstrip("/").partition("!")[0]

    def _fault(self, key: str, text: str, allowed: str) -> ValueError:
        return ValueError(f"{self.path.name}: {key!r} of model {self._number} is {text!r}; {allowed}")


def _model(record: _Record, checksum: tuple[int, int]) -> CatalogueModel:
    name, group = record.text("name"), record.text("category")
    identity = record.text("id", f"{record.path.stem}#{record.file()}")
    return CatalogueModel(
        id=identity,
        name=name,
        group=group,
        kind=kind_of(identity, group, name),
        size=(record.metres("width"), record.metres("depth"), record.metres("height")),
        elevation_m=record.metres("elevation", "0"),
        rotation=record.rotation(),
        is_opening=record.text("doorOrWindow", "false").lower() == "true",
        author=record.shared("creator"),
        licence=" ".join(record.shared("license").split()),
        catalogue=record.of_catalogue("name", record.path.stem),
        archive=record.path,
        path=record.text("model").lstrip("/"),
        checksum=checksum,
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _format(path: str) -> str:
    return Path(path).suffix.lower()
