"""Write shards: tars whose bytes depend on the samples alone, and their part of the index.

Owns completeness. A shard counts once its record stands in the work folder, and the record is written
after tar and index rows are on disk; whatever a killed job leaves else is written again.
"""

import dataclasses
import hashlib
import io
import json
import tarfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from langwm_data import atomic
from langwm_data.scenes.spec import Split
from langwm_data.shards.index import FRAMES_SCHEMA, OBJECTS_SCHEMA, frame_row, object_rows
from langwm_data.shards.manifest import ShardRecord
from langwm_data.shards.sample import Sample, encode_sample

WORK_DIR = ".work"
"""Records and index parts of shards while the dataset is being made."""

_CHUNK = 1 << 20


class TarWriter:
    """Append files to an uncompressed tar and say where their bytes lie.

    Times, owners and rights are fixed, so equal files in equal order give equal tars. Headers are
    USTAR, which every reader of the last decades knows.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._digest = hashlib.sha256()
        self.size = 0

    def add(self, name: str, data: bytes) -> tuple[int, int]:
        """Append one file; the offset and size of its bytes in the tar."""
        offset = self.size + tarfile.BLOCKSIZE
        self._write(b"".join((make_header(name, len(data)), data, bytes(-len(data) % tarfile.BLOCKSIZE))))
        return offset, len(data)

    def finish(self) -> str:
        """Write the end of the archive; the SHA-256 of all of it."""
        self._write(bytes(2 * tarfile.BLOCKSIZE))
        self._write(bytes(-self.size % tarfile.RECORDSIZE))
        return self._digest.hexdigest()

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._digest.update(data)
        self.size += len(data)


def _blank_header() -> bytes:
    info = tarfile.TarInfo("")
    info.mode = 0o444
    return info.tobuf(tarfile.USTAR_FORMAT)


_BLANK = _blank_header()
_NAME, _SIZE, _CHECKSUM = slice(0, 100), slice(124, 136), slice(148, 156)
"""Where a header has them. Source: POSIX.1-1988, ustar."""
_BLANK_SUM = int(_BLANK[_CHECKSUM][:6], 8) - sum(_BLANK[_SIZE])


def make_header(name: str, size: int) -> bytes:
    """A file's header, as ``tarfile`` makes it, which takes six times as long."""
    encoded, digits = name.encode("utf-8", "surrogateescape"), b"%011o\0" % size
    assert len(encoded) <= _NAME.stop, name
    assert len(digits) == _SIZE.stop - _SIZE.start, size
    checksum = b"%06o\0 " % (_BLANK_SUM + sum(encoded) + sum(digits))
    return b"".join(
        (
            encoded.ljust(_NAME.stop, b"\0"),
            _BLANK[_NAME.stop : _SIZE.start],
            digits,
            _BLANK[_SIZE.stop : _CHECKSUM.start],
            checksum,
            _BLANK[_CHECKSUM.stop :],
        )
    )


def shard_path(split: Split, number: int) -> str:
    """Where shard ``number`` of a split lies, relative to the dataset."""
    return f"{split}/{split}-{number:06d}.tar"


def write_shard(folder: Path, split: Split, number: int, samples: Iterable[Sample]) -> ShardRecord:
    """Write one shard, its rows of the index, and last the record that makes it count.

    When ``samples`` raises or the disk is full, nothing of the shard is left behind.
    """
    relative = shard_path(split, number)
    frames: list[dict[str, Any]] = []
    objects: list[dict[str, Any]] = []
    with atomic.atomic_path(folder / relative) as temporary, temporary.open("wb") as file:
        tar = TarWriter(file)
        for sample in samples:
            files = encode_sample(sample)
            places = {name: tar.add(f"{sample.key}.{name}", data) for name, data in files.items()}
            frames.append(frame_row(sample, relative, places))
            objects += object_rows(sample)
        sha256 = tar.finish()
    record = ShardRecord(path=relative, split=split, samples=len(frames), bytes=tar.size, sha256=sha256)
    part = _part(folder, relative)
    write_table(part.with_suffix(".frames.parquet"), pa.Table.from_pylist(frames, FRAMES_SCHEMA))
    write_table(part.with_suffix(".objects.parquet"), pa.Table.from_pylist(objects, OBJECTS_SCHEMA))
    atomic.write_json(part, dataclasses.asdict(record))
    return record


def read_record(folder: Path, relative: str, *, size: int | None = None) -> ShardRecord | None:
    """The record of a shard whose tar has the right size; else nothing.

    Args:
        folder: Where the record lies, and the tar unless its ``size`` is given.
        relative: The shard.
        size: Bytes of the tar where it lies elsewhere.
    """
    tar, part = folder / relative, _part(folder, relative)
    if not part.is_file():
        return None
    if size is None and tar.is_file():
        size = tar.stat().st_size
    record = ShardRecord(**json.loads(part.read_text("utf-8")))
    return record if size == record.bytes else None


def complete_shard(folder: Path, relative: str) -> ShardRecord | None:
    """The record of a shard that is there whole, its bytes compared with the checksum; else nothing."""
    record = read_record(folder, relative)
    if record is None or sha256_of(folder / relative) != record.sha256:
        return None
    return record


def part_files(relative: str) -> tuple[str, str, str]:
    """The rows of a shard and its record, in the order in which they are written."""
    part = _part(Path(), relative)
    return (str(part.with_suffix(".frames.parquet")), str(part.with_suffix(".objects.parquet")), str(part))


def read_parts(folder: Path, records: Iterable[ShardRecord]) -> tuple[pa.Table, pa.Table]:
    """The rows of frames and of objects of these shards, in their order."""
    parts = [_part(folder, record.path) for record in records]
    frames = [pq.ParquetFile(part.with_suffix(".frames.parquet")).read() for part in parts]
    objects = [pq.ParquetFile(part.with_suffix(".objects.parquet")).read() for part in parts]
    return pa.concat_tables(frames), pa.concat_tables(objects)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a parquet file atomically."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    atomic.write_bytes(path, buffer.getvalue())


def sha256_of(path: Path) -> str:
    """SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def _part(folder: Path, relative: str) -> Path:
    return folder / WORK_DIR / Path(relative).with_suffix(".json").name
