"""The manifest of a dataset: what it holds, how it was made, and the checksum of every shard.

``dataset.json`` is written last, so a folder that has one is complete.
"""

import dataclasses
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from langwm_data import __version__, atomic
from langwm_data.config import SplitsConfig
from langwm_data.config_io import ConfigError, build_config
from langwm_data.scenes.spec import Split
from langwm_data.scenes.splits import EVERYTHING, HeldOut
from langwm_data.shards.sample import DatasetError

MANIFEST_FILE = "dataset.json"
CARD_FILE = "README.md"
FRAMES_FILE = "index/frames.parquet"
OBJECTS_FILE = "index/objects.parquet"

SCHEMA_VERSION = 3
GENERATOR = f"langwm {__version__}"
"""What this program calls itself in the datasets that it makes."""
SHARD_PATTERN = r"(train|test)/(train|test)-\d{6}\.tar"


@dataclass(frozen=True, kw_only=True)
class ShardRecord:
    """One tar of a finished dataset."""

    path: str
    """Relative to the dataset, ``train/train-000000.tar``."""
    split: Split
    samples: int
    bytes: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class SplitRecord:
    """What one split holds."""

    frames: int
    scenes: dict[str, int]
    """Frames by scene."""


@dataclass(frozen=True, kw_only=True)
class CameraRecord:
    """What all frames have in common; poses stand in each sample."""

    height: int
    width: int
    K: list[list[float]]
    """3x3, pixels, pixel centres at .5."""
    depth_unit_m: float
    """Stored depth times this is metres."""


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """The content of ``dataset.json``."""

    schema_version: int = SCHEMA_VERSION
    generator: str
    """Program and version."""
    fingerprint: str
    """SHA-256 over config, sources, physics, generator and renderer: equal fingerprints, equal shards."""
    physics: str
    """What let loose things come to rest, with its version."""
    renderer: str
    config: dict[str, Any]
    sources: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the files of others that scenes are made from, by field of ``config.scenes``."""
    camera: CameraRecord
    categories: dict[str, int]
    """Visible instances by category, over all frames."""
    category_ids: dict[str, Annotated[int, Field(ge=1, le=255)]]
    """Number of each category in semantic masks and COCO files, seen in a frame or not."""
    splits: dict[Split, SplitRecord]
    frames: int
    objects: int
    captions: int
    files: dict[str, str]
    """SHA-256 of scenes and index by path, relative to the dataset. Not of the data card, whose words may be
    changed."""
    shards: list[ShardRecord]

    @property
    def holds_out(self) -> tuple[HeldOut, ...]:
        """What its test frames claim not to share with training frames; see ``side_of``.

        Raises:
            DatasetError: If its configuration says something else here than this program can.
        """
        splits = self.config.get("splits")
        if not isinstance(splits, dict) or "holds_out" not in splits:
            return EVERYTHING
        try:
            values = {"holds_out": splits["holds_out"], "test_fraction": 1}
            return build_config(SplitsConfig, values).holds_out
        except ConfigError as error:
            raise DatasetError(f"{MANIFEST_FILE}: config: {error}") from error


for _cls in (ShardRecord, SplitRecord, CameraRecord, Manifest):
    _cls.__pydantic_config__ = ConfigDict(extra="forbid")  # pyright: ignore[reportAttributeAccessIssue]
_ADAPTER = TypeAdapter(Manifest)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``dataset.json``, which makes the dataset complete."""
    atomic.write_text(folder / MANIFEST_FILE, manifest_text(manifest))


def manifest_text(manifest: Manifest) -> str:
    """The content of ``dataset.json``."""
    return json.dumps(dataclasses.asdict(manifest), indent=2, allow_nan=False) + "\n"


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``dataset.json``.

    Raises:
        DatasetError: If ``folder`` is missing, holds no finished dataset, or one this program cannot read.
    """
    if folder.is_file():
        raise DatasetError(f"no dataset at {str(folder)!r}: it is a file; give the folder")
    if not folder.is_dir():
        raise DatasetError(f"no dataset at {str(folder)!r}: the folder does not exist")
    path = folder / MANIFEST_FILE
    if not path.is_file():
        raise DatasetError(f"no finished dataset at {str(folder)!r}: it has no {MANIFEST_FILE}")
    text = path.read_bytes()
    version = _schema_version(path, text)
    if version != SCHEMA_VERSION:
        raise DatasetError(f"{path}: dataset schema version {version}; this program reads {SCHEMA_VERSION}")
    try:
        manifest: Manifest = _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(p) for p in first["loc"]) or "the document"
        raise DatasetError(f"{path}: {where}: {first['msg']}") from error
    if unnumbered := sorted(set(manifest.categories) - set(manifest.category_ids)):
        raise DatasetError(f"{path}: category_ids has no number for {unnumbered[0]!r}")
    for shard in manifest.shards:
        if not re.fullmatch(SHARD_PATTERN, shard.path):
            raise DatasetError(f"{path}: shard path {shard.path!r} is not of the form train/train-000000.tar")
    return manifest


def _schema_version(path: Path, text: bytes) -> Any:  # noqa: ANN401
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is damaged: it is not JSON") from error
    if not isinstance(document, dict) or "schema_version" not in document:
        raise DatasetError(f"{path} is damaged: it has no schema_version")
    return document["schema_version"]
