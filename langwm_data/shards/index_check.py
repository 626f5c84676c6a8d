"""Does the index say what the shards hold? Rows are made again from the samples and compared.

Owns reading the two parquet files a few rows at a time, after a look at how large they claim to be.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from langwm_data.shards.findings import WRONG_CHECKSUM, Finding, foreign
from langwm_data.shards.index import FRAMES_SCHEMA, OBJECTS_SCHEMA
from langwm_data.shards.manifest import FRAMES_FILE, OBJECTS_FILE, Manifest
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.writer import sha256_of

_BATCH_ROWS = 64
_BYTES_PER_ROW, _BYTES_ALWAYS = 8192, 1 << 20
"""Most that a table may unpack to: a row's longest entry is its list of materials, 2 kB."""


def open_index(path: Path, schema: pa.Schema, num_rows: int) -> pq.ParquetFile:
    """Open one of the two tables; nothing of its rows is read yet.

    Raises:
        DatasetError: If it is missing, not parquet, has other columns or another number of rows, or
            would unpack to more than its rows can need.
    """
    try:
        file = pq.ParquetFile(path, buffer_size=1 << 16, pre_buffer=False)
    except (OSError, ValueError, pa.ArrowException) as error:  # ValueError: a name that is not UTF-8
        raise DatasetError(f"{path} is missing or is not a parquet file") from error
    if not file.schema_arrow.equals(schema):
        raise DatasetError(f"{path} has other columns than this program writes")
    if file.metadata.num_rows != num_rows:
        raise DatasetError(f"{path} has {file.metadata.num_rows} rows; the manifest says {num_rows}")
    limit = _BYTES_ALWAYS + _BYTES_PER_ROW * num_rows
    # Not column by column: of some damaged files pyarrow ends the process when asked for a column's metadata.
    sizes = [file.metadata.row_group(n).total_byte_size for n in range(file.metadata.num_row_groups)]
    if any(size < 0 for size in sizes) or sum(sizes) > limit:
        raise DatasetError(
            f"{path} unpacks to {sum(sizes)} bytes in groups of rows; allowed for {num_rows} rows: {limit}"
        )
    return file


def check_rows(file: pq.ParquetFile) -> None:
    """Unpack a whole table, a few rows at a time.

    Raises:
        DatasetError: If it cannot be unpacked.
    """
    num_rows = 0
    try:
        for batch in _iter_batches(file):
            batch.validate(full=True)
            num_rows += len(batch)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DatasetError("its rows cannot be unpacked") from error
    if num_rows != file.metadata.num_rows:
        raise DatasetError(f"it unpacks to {num_rows} rows and says that it has {file.metadata.num_rows}")


@dataclass(frozen=True, kw_only=True)
class Span:
    """The rows of one shard: ``start`` to ``stop`` (exclusive) in a table."""

    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class IndexPlan:
    """Where the rows of each shard lie, by path; empty where the index cannot be compared."""

    frames: Mapping[str, Span]
    objects: Mapping[str, Span]


def check_tables(folder: Path, manifest: Manifest) -> tuple[IndexPlan, list[Finding]]:
    """Compare the tables with the manifest, and find the rows of each shard."""
    findings = [
        Finding(where=name, what=WRONG_CHECKSUM)
        for name in (FRAMES_FILE, OBJECTS_FILE)
        if (folder / name).is_file() and sha256_of(folder / name) != manifest.files.get(name)
    ]
    try:
        frames = open_index(folder / FRAMES_FILE, FRAMES_SCHEMA, manifest.frames)
        check_rows(frames)
    except DatasetError as error:
        return IndexPlan(frames={}, objects={}), [*findings, _finding(folder, FRAMES_FILE, error)]
    table = frames.read(["key", "split", "scene", "num_captions"])
    spans, start = {}, 0
    for shard in manifest.shards:
        spans[shard.path] = Span(start=start, stop=start + shard.samples)
        start += shard.samples
    findings += _compare_frames(table, manifest)
    try:
        file = open_index(folder / OBJECTS_FILE, OBJECTS_SCHEMA, manifest.objects)
        check_rows(file)
    except DatasetError as error:
        return IndexPlan(frames=spans, objects={}), [*findings, _finding(folder, OBJECTS_FILE, error)]
    objects = file.read(["key", "category"])
    object_spans, more = _object_spans(table["key"], objects, spans)
    if _counts(objects["category"]) != manifest.categories:
        more.append(Finding(where=OBJECTS_FILE, what="its categories are not counted as in the manifest"))
    return IndexPlan(frames=spans, objects=object_spans), findings + more


def _finding(folder: Path, where: str, error: DatasetError) -> Finding:
    return Finding(where=where, what=str(error).removeprefix(str(folder / where)).lstrip(": "))


def _compare_frames(table: pa.Table, manifest: Manifest) -> list[Finding]:
    """Keys are unique; counts by split, scene and caption are those of the manifest."""
    findings = [
        Finding(where=FRAMES_FILE, key=_name(key), what=f"this key is there {count} times")
        for key, count in _duplicates(table["key"].to_pylist())
    ]
    found = {
        split: _counts(table.filter(pc.field("split") == split)["scene"])
        for split in dict.fromkeys(table["split"].to_pylist())
    }
    if found != {name: split.scenes for name, split in manifest.splits.items()}:
        findings.append(
            Finding(where=FRAMES_FILE, what="splits and scenes are not counted as in the manifest")
        )
    if sum(table["num_captions"].to_pylist()) != manifest.captions:
        findings.append(Finding(where=FRAMES_FILE, what="captions are not counted as in the manifest"))
    return findings


def _object_spans(
    keys: pa.ChunkedArray, objects: pa.Table, frames: Mapping[str, Span]
) -> tuple[dict[str, Span], list[Finding]]:
    """Which rows of objects belong to which shard; they stand in the order of the frames."""
    found = pc.call_function("index_in", [objects["key"]], pc.SetLookupOptions(value_set=keys))
    rows = found.to_numpy().astype(np.float64)  # NaN for a key that no frame has
    is_lost = np.isnan(rows)
    is_lost[1:] |= rows[1:] < rows[:-1]
    if is_lost.any():
        row = int(is_lost.argmax())
        what = f"row {row} belongs to no frame or is not in the order of the frames"
        return {}, [Finding(where=OBJECTS_FILE, key=_name(objects["key"][row].as_py()), what=what)]
    bounds = {path: rows.searchsorted([span.start, span.stop]).tolist() for path, span in frames.items()}
    return {path: Span(start=a, stop=b) for path, (a, b) in bounds.items()}, []


def _duplicates(keys: Sequence[str]) -> list[tuple[str, int]]:
    return [(key, count) for key, count in Counter(keys).most_common(10) if count > 1]


def _counts(column: pa.ChunkedArray) -> dict[Any, int]:
    return {entry["values"]: entry["counts"] for entry in column.value_counts().to_pylist()}


def _name(key: object) -> str:
    return foreign(key).strip("'")


class RowReader:
    """Rows of a table as dicts, asked for in ascending order; only a few are held at a time."""

    def __init__(self, file: pq.ParquetFile) -> None:
        self._rows = _iter_rows(file)
        self._position = 0
        self._last: dict[str, Any] | None = None

    def take(self, span: Span) -> Iterator[tuple[dict[str, Any] | None, dict[str, Any]]]:
        """The rows of one shard, after those that nobody took before, each with the row before it."""
        while self._position < span.stop:
            before, self._last = self._last, next(self._rows)
            self._position += 1
            if self._position > span.start:
                yield before, self._last


def _iter_rows(file: pq.ParquetFile) -> Iterator[dict[str, Any]]:
    for batch in _iter_batches(file):
        yield from batch.to_pylist()


def _iter_batches(file: pq.ParquetFile) -> Iterator[pa.RecordBatch]:
    return file.iter_batches(_BATCH_ROWS, use_threads=False)


def row_fault(found: Mapping[str, Any], made: Mapping[str, Any]) -> str:
    """In which column a row differs from the one made again of its sample; empty where in none."""
    for name, value in made.items():
        other = found[name]
        if other == value or (isinstance(value, float) and math.isclose(other or 0.0, value, abs_tol=1e-9)):
            continue
        return f"its {name} in the index is {foreign(other)}; the sample says {foreign(value)}"
    return ""
