"""Read a rendered dataset: by number, by key, selected, or as a stream. No torch needed.

Samples are read from the tars at the offsets that the index gives, one read per sample and nothing
scanned. Paths and offsets are checked against the manifest, so a damaged or hostile dataset cannot make
this code read outside its folder.
"""

import os
import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from langwm_data.scenes.assets import ASSETS_DIR, Assets
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.shards.index import COLUMN_OF_FILE, FRAMES_SCHEMA, OBJECTS_SCHEMA
from langwm_data.shards.index_check import open_index
from langwm_data.shards.manifest import FRAMES_FILE, OBJECTS_FILE, Manifest, read_manifest
from langwm_data.shards.sample import (
    FIELD_OF_FILE,
    FILE_KEYS,
    KEY_PATTERN,
    DatasetError,
    Sample,
    decode_fields,
)
from langwm_data.shards.scenes import read_scene
from langwm_data.shards.stream import SampleStream


class ShardDataset:
    """A finished dataset as a sequence of ``Sample``.

    Works from several threads and processes at once: nothing is held open between reads.

    Args:
        path: Folder that holds ``dataset.json``.

    Raises:
        DatasetError: If the folder is missing, holds no finished dataset, or a damaged one.
    """

    def __init__(self, path: Path | str) -> None:
        folder = Path(path)
        manifest = read_manifest(folder)
        frames = _read_table(folder / FRAMES_FILE, FRAMES_SCHEMA, manifest.frames)
        _check_frames(folder, manifest, frames)
        self._bind(folder, manifest, frames)

    def _bind(self, folder: Path, manifest: Manifest, frames: pa.Table) -> None:
        self.path = folder
        self.manifest = manifest
        self.frames = frames
        self._shards: list[str] = frames["shard"].to_pylist()
        self._keys: list[str] = frames["key"].to_pylist()
        self._places = _places(frames)

    @cached_property
    def objects(self) -> pa.Table:
        """A row per visible object of the frames held, in the order of the index."""
        table = _read_table(self.path / OBJECTS_FILE, OBJECTS_SCHEMA, self.manifest.objects)
        if len(self) == self.manifest.frames:
            return table
        return table.filter(pc.field("key").isin(self._keys))

    @cached_property
    def _number_of_key(self) -> dict[str, int]:
        return {key: number for number, key in enumerate(self._keys)}

    def __len__(self) -> int:
        return len(self._keys)

    def __getitem__(self, which: int | str) -> Sample:
        """Read one sample, by its number (negative counts from the end) or its key."""
        return Sample(**self.read_files(which, FILE_KEYS))

    def only(self, *fields: str) -> "FieldReader":
        """The same samples as dicts of some of their fields; the others are not decoded.

        Args:
            fields: Names of fields of ``Sample``, such as ``"rgb", "depth"``.

        Raises:
            ValueError: If none is named, or a sample has no such field.
        """
        file_of = {field: name for name, field in FIELD_OF_FILE.items()}
        if not fields or not set(fields) <= set(file_of):
            raise ValueError(f"fields are {fields}; allowed: one or more of {', '.join(file_of)}")
        return FieldReader(self, [file_of[field] for field in fields])

    def read_files(self, which: int | str, files: Sequence[str]) -> dict[str, Any]:
        """The key of one sample and the fields that the given files of it hold, decoded, by name.

        Args:
            which: Number or key of the sample.
            files: Some of ``FILE_KEYS``.
        """
        number = self._number_of_key[which] if isinstance(which, str) else range(len(self))[which]
        places = dict(zip(COLUMN_OF_FILE, self._places[number].tolist(), strict=True))
        wanted = {name: places[name] for name in files}
        start = min(offset for offset, _ in wanted.values())
        stop = max(offset + size for offset, size in wanted.values())
        data = _read_range(self.path / self._shards[number], start, stop - start)
        parts = {
            name: data[offset - start : offset - start + size] for name, (offset, size) in wanted.items()
        }
        return {"key": self._keys[number], **decode_fields(parts, self._keys[number])}

    def __iter__(self) -> Iterator[Sample]:
        return (self[number] for number in range(len(self)))

    @property
    def keys(self) -> list[str]:
        """Names of the samples, in order."""
        return list(self._keys)

    @property
    def assets(self) -> Assets:
        """The meshes and pictures of its scenes."""
        return Assets(self.path / ASSETS_DIR)

    def scene(self, name: str) -> SceneSpec:
        """The baked scene called ``name``, enough to render its frames again.

        Raises:
            DatasetError: If no frame of this dataset shows a scene of that name, or its file is damaged.
        """
        known = sorted({s for split in self.manifest.splits.values() for s in split.scenes})
        if name not in known:
            raise DatasetError(f"no scene {name!r} in {str(self.path)!r}; there are: {', '.join(known)}")
        return read_scene(self.path, name)

    def select(
        self,
        *,
        split: Split | None = None,
        filter: pc.Expression | None = None,
        objects: pc.Expression | None = None,
    ) -> Self:
        """The part of the dataset that meets all conditions given, in the same order.

        Args:
            split: Keep frames of this split.
            filter: Keep frames for which this holds, over the columns of ``frames``.
            objects: Keep frames that show an object for which this holds, over the columns of
                ``objects``, such as ``pc.field("category") == "chair"``.

        Raises:
            DatasetError: If the dataset has no such split.
        """
        frames = self.frames
        if split is not None:
            if split not in self.manifest.splits:
                known = ", ".join(self.manifest.splits)
                raise DatasetError(f"no split {split!r} in {str(self.path)!r}; there are: {known}")
            frames = frames.filter(pc.field("split") == split)
        if filter is not None:
            frames = frames.filter(filter)
        if objects is not None:
            shown = self.objects.filter(objects)["key"].unique()
            frames = frames.filter(pc.field("key").isin(shown))
        part = object.__new__(type(self))
        part._bind(self.path, self.manifest, frames)
        return part

    def iter(
        self, *, shuffle_seed: int | None = None, part: int = 0, num_parts: int = 1
    ) -> SampleStream[Sample]:
        """Stream epochs of the samples; the stream's position can be saved and restored.

        Args:
            shuffle_seed: Draws a new order for each epoch; ``None`` keeps the order of the index.
            part: Which of ``num_parts`` disjoint parts to read, such as
                ``rank * num_workers + worker``.
            num_parts: In how many parts each epoch is divided, such as ``num_ranks * num_workers``;
                their sizes differ by at most one.

        Raises:
            ValueError: If ``part`` is not in ``range(num_parts)``.
        """
        return SampleStream(self, shuffle_seed=shuffle_seed, part=part, num_parts=num_parts)


class FieldReader:
    """Samples of a dataset as dicts of some of their fields: a map-style dataset, and a source of streams.

    Made by ``ShardDataset.only``.
    """

    def __init__(self, dataset: ShardDataset, files: Sequence[str]) -> None:
        self._dataset, self._files = dataset, files

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, which: int | str) -> dict[str, Any]:
        return self._dataset.read_files(which, self._files)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[number] for number in range(len(self)))


def _places(frames: pa.Table) -> np.ndarray:
    """(N, files, 2): offset and size of every file."""
    columns = [
        frames[f"{stem}_{what}"].to_numpy()
        for stem in COLUMN_OF_FILE.values()
        for what in ("offset", "bytes")
    ]
    return np.stack(columns, axis=-1).reshape(len(frames), len(COLUMN_OF_FILE), 2)


def _check_frames(folder: Path, manifest: Manifest, frames: pa.Table) -> None:
    if any(column.null_count for column in frames.columns):
        raise DatasetError(f"{folder / FRAMES_FILE} has empty fields")
    if not all(re.fullmatch(KEY_PATTERN, key) for key in frames["key"].to_pylist()):
        raise DatasetError(f"{folder / FRAMES_FILE} has a key of other characters than {KEY_PATTERN}")
    size_of = {shard.path: shard.bytes for shard in manifest.shards}
    if unknown := set(frames["shard"].unique().to_pylist()) - set(size_of):
        raise DatasetError(
            f"{folder / FRAMES_FILE} names shard {min(unknown)!r}, which is not in the manifest"
        )
    limits = np.array([size_of[s] for s in frames["shard"].to_pylist()], dtype=np.int64)
    places = _places(frames)
    # Not as a sum, which could pass the largest number.
    if (places < 0).any() or (places[..., 0] > limits[:, None] - places[..., 1]).any():
        raise DatasetError(f"{folder / FRAMES_FILE} points outside a shard")


def _read_table(path: Path, schema: pa.Schema, num_rows: int) -> pa.Table:
    try:
        return open_index(path, schema, num_rows).read()
    except (OSError, pa.ArrowException) as error:
        raise DatasetError(f"{path} is damaged: its rows cannot be unpacked") from error


def _read_range(path: Path, offset: int, size: int) -> bytes:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError as error:
        raise DatasetError(f"shard {path} is missing") from error
    try:
        data = os.pread(descriptor, size, offset)
    finally:
        os.close(descriptor)
    if len(data) != size:
        raise DatasetError(f"shard {path} is shorter than its index says")
    return data
