"""One file for each episode: how it is written, and how single steps are read from it.

Owns the format: safetensors, one tensor for each column, pictures as they are. PNGs would take a quarter
of the disk, but a batch of 16 x 50 then costs 1.1 s of CPU to read instead of 0.2 s.

Steps are read by position into the caller's arrays. Maps of the files would be read a third faster, but
whatever was touched counts as resident memory, up to the whole buffer; opening with ``safe_open`` for each
draw takes twice the time.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agent.replay.episodes import ReplayEpisode
from langwm_data import atomic
from pretrain.frames import FrameObject

SCHEMA_VERSION = 3
OBJECT_BYTES = 56
"""Of one object seen at one step."""
OBJECTS_A_STEP = 12
"""How many there are of them, in round figures: the homes show fewer."""
FEATURE = "feature/"
"""Prefix of columns that hold features."""
_DTYPES = {
    "U8": np.dtype(np.uint8),
    "U16": np.dtype(np.uint16),
    "I64": np.dtype(np.int64),
    "F16": np.dtype(np.float16),
    "F32": np.dtype(np.float32),
    "F64": np.dtype(np.float64),
}
_NAMES = {dtype: name for name, dtype in _DTYPES.items()}
_MAX_HEADER = 2**24
_IN_MEMORY = ("task", "action", "reward")
"""Columns so small that the index holds them."""


class Column(NamedTuple):
    """Where one column lies in the file."""

    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]


@dataclass(frozen=True)
class StoredEpisode:
    """One stored episode in the index."""

    path: Path
    length: int
    is_terminal: bool
    names: tuple[tuple[str, str], ...]
    """Category and noun of the objects seen in it."""
    columns: Mapping[str, Column]
    task: np.ndarray
    action: np.ndarray
    reward: np.ndarray

    @property
    def step_shapes(self) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
        """Type and shape of one step of every column that has a row for each step."""
        held = self.columns.items()
        return {name: (c.dtype, c.shape[1:]) for name, c in held if not name.startswith("object_")}

    def read(self, into: Mapping[str, np.ndarray], start: int) -> None:
        """Fill each array of ``into`` with rows of the column of its name, from row ``start`` on.

        Raises:
            ValueError: If the file has become shorter.
            OSError: If it cannot be read.
        """
        fd = os.open(self.path, os.O_RDONLY)
        try:
            for name, array in into.items():
                self._fill(fd, self.columns[name], array, start)
        finally:
            os.close(fd)

    def read_objects(self, start: int, stop: int) -> list[list[FrameObject]]:
        """Objects of the steps from ``start`` to ``stop`` (exclusive)."""
        offset = np.empty(stop - start + 1, np.int64)
        self.read({"object_offset": offset}, start)
        first, last = int(offset[0]), int(offset[-1])
        columns = {name: self.columns[f"object_{name}"] for name in ("name", "box", "center_x", "distance_m")}
        arrays = {k: np.empty((last - first, *c.shape[1:]), c.dtype) for k, c in columns.items()}
        self.read({f"object_{name}": array for name, array in arrays.items()}, first)
        flat = [
            FrameObject(
                category=self.names[n][0],
                phrase=self.names[n][1],
                bbox_xyxy=tuple(box),
                center_x=x,
                distance_m=d,
            )
            for n, box, x, d in zip(*(a.tolist() for a in arrays.values()), strict=True)
        ]
        return [flat[a - first : b - first] for a, b in pairwise(offset.tolist())]

    def _fill(self, fd: int, column: Column, array: np.ndarray, start: int) -> None:
        assert array.dtype == column.dtype
        assert array.shape[1:] == column.shape[1:]
        row = column.dtype.itemsize * int(np.prod(column.shape[1:], dtype=np.int64))
        buffer, position = array.reshape(-1).view(np.uint8).data, column.offset + start * row
        while len(buffer):
            count = os.preadv(fd, [buffer], position)
            if count == 0:
                raise _damaged(self.path, "it ends too early")
            buffer, position = buffer[count:], position + count


def step_bytes(
    height: int, width: int, numbers: int, *, with_depth: bool, with_objects: bool, features: int = 0
) -> int:
    """Bytes on disk of one step.

    Args:
        height: Of the frame, pixels.
        width: Of the frame, pixels.
        numbers: Entries of task observation and action together.
        with_depth: Whether depth is stored.
        with_objects: Whether objects are stored; ``OBJECTS_A_STEP`` are assumed.
        features: Numbers that were computed once a step.
    """
    objects = 8 + OBJECT_BYTES * OBJECTS_A_STEP if with_objects else 0
    return height * width * (5 if with_depth else 3) + 4 * (numbers + 1) + objects + 2 * features


def write_episode(path: Path, episode: ReplayEpisode) -> StoredEpisode:
    """Write a finished episode, whole or not at all.

    Raises:
        OSError: If it cannot be written, for instance because the disk is full.
    """
    names: list[tuple[str, str]] = []
    arrays = {"rgb": episode.rgb, "task": episode.task, "action": episode.action, "reward": episode.reward}
    if episode.depth_mm is not None:
        arrays["depth_mm"] = episode.depth_mm
    arrays |= {FEATURE + name: values for name, values in episode.features.items()}
    lengths = {name: len(array) for name, array in arrays.items()}
    if episode.objects is not None:
        lengths["objects"] = len(episode.objects)
        names = sorted({(o.category, o.phrase) for frame in episode.objects for o in frame})
        arrays |= _object_columns(episode.objects, names)
    assert len(set(lengths.values())) == 1, f"columns of unequal length: {lengths}"
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    about = {"schema_version": SCHEMA_VERSION, "is_terminal": episode.is_terminal, "names": names}
    header = _make_header(arrays, about)
    try:
        with atomic.atomic_path(path) as temporary, temporary.open("wb") as file:
            file.write(header)
            for array in arrays.values():
                file.write(array.reshape(-1).view(np.uint8).data)
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    return read_entry(path)


def read_entry(path: Path) -> StoredEpisode:
    """What the index must know of a stored episode.

    Raises:
        ValueError: If the file is missing, damaged or of another version.
    """
    try:
        columns, about = _read_header(path)
        version, is_terminal, names = (about[k] for k in ("schema_version", "is_terminal", "names"))
        if version != SCHEMA_VERSION:
            raise ValueError(f"it has schema version {version}; known: {SCHEMA_VERSION}")
        small = {name: np.empty(columns[name].shape, columns[name].dtype) for name in _IN_MEMORY}
        names = tuple((str(category), str(noun)) for category, noun in names)
        length = columns["reward"].shape[0]
        entry = StoredEpisode(path, length, bool(is_terminal), names, columns, **small)
        entry.read(small, 0)
    except (OSError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise _damaged(path, error) from error
    return entry


def _damaged(path: Path, why: object) -> ValueError:
    return ValueError(
        f"{path} of the replay buffer is missing or damaged ({why}); start the run over with --fresh"
    )


def _object_columns(
    objects: Sequence[Sequence[FrameObject]], names: list[tuple[str, str]]
) -> dict[str, np.ndarray]:
    flat = [o for frame in objects for o in frame]
    return {
        "object_offset": np.cumsum([0, *map(len, objects)], dtype=np.int64),
        "object_name": np.array([names.index((o.category, o.phrase)) for o in flat], np.int64),
        "object_box": np.array([o.bbox_xyxy for o in flat], np.float64).reshape(-1, 4),
        "object_center_x": np.array([o.center_x for o in flat], np.float64),
        "object_distance_m": np.array([o.distance_m for o in flat], np.float64),
    }


def _make_header(arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> bytes:
    """Length, then JSON padded to a multiple of 8. Source: the safetensors format."""
    held: dict[str, Any] = {"__metadata__": {"replay": json.dumps(about)}}
    end = 0
    for name, array in arrays.items():
        begin, end = end, end + array.nbytes
        shape = list(array.shape)
        held[name] = {"dtype": _NAMES[array.dtype], "shape": shape, "data_offsets": [begin, end]}
    text = json.dumps(held).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text


def _read_header(path: Path) -> tuple[dict[str, Column], dict[str, Any]]:
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        length = int.from_bytes(file.read(8), "little")
        if not 2 <= length <= min(_MAX_HEADER, size - 8):
            raise ValueError("it does not begin with a header")
        held = json.loads(file.read(length))
    about = json.loads(held.pop("__metadata__")["replay"])
    columns = {}
    for name, value in held.items():
        dtype, shape = _DTYPES[value["dtype"]], tuple(int(n) for n in value["shape"])
        begin, end = (int(n) + 8 + length for n in value["data_offsets"])
        is_whole = end - begin == dtype.itemsize * int(np.prod(shape, dtype=object))
        if min(shape, default=0) < 0 or not 0 <= begin <= end <= size or not is_whole:
            raise ValueError(f"column {name} does not fit into it")
        columns[name] = Column(begin, dtype, shape)
    return columns, about
