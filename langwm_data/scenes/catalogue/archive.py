"""Zip archives from strangers: what is in them, and the bytes of one entry.

Nothing is ever unpacked to disk. An archive is refused as a whole, in one sentence that names it, where
its directory holds anything that an honest catalogue does not: links, paths that lead out, entries that
grow out of proportion. What the bytes mean is the business of others.
"""

import io
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Self

MAX_ARCHIVE_BYTES = 2**31
MAX_ENTRIES = 20_000
"""The largest of the five Debian catalogues has 1,931."""
MAX_ENTRY_BYTES = 2**27
MAX_TOTAL_BYTES = 2**32
MAX_RATIO = 200
"""How often an entry may be larger than its compressed form; OBJ text reaches 11."""
RATIO_FREE_BYTES = 2**20
"""Smaller entries may be compressed as they like."""
MAX_DEPTH = 1
"""An archive may hold archives, but these no others."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1
_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, ValueError, RuntimeError)
"""What ``zipfile`` raises for damage; the last three where a directory points before the start of the file,
and where the head of an entry says that it is encrypted."""


class ArchiveError(ValueError):
    """An archive that is damaged or looks hostile."""


class Archive:
    """The entries of one zip file, checked before any of them is read. Use ``open_archive``."""

    def __init__(self, file: zipfile.ZipFile, label: str, depth: int = 0) -> None:
        """Check the directory of ``file``.

        Args:
            file: An open zip file; it stays the caller's.
            label: What messages call it.
            depth: In how many other archives it lies.

        Raises:
            ArchiveError: If it holds what must not be there.
        """
        self.label = label
        self._file = file
        self._depth = depth
        self._entries = _checked_entries(file, label)

    def __contains__(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return name in self._entries

    def names(self) -> tuple[str, ...]:
        """All files, in the order of the directory; folders are left out."""
        return tuple(self._entries)

    def checksum(self, name: str) -> tuple[int, int]:
        """CRC-32 and size of a file as the directory states them: equal for equal files, unread."""
        entry = self._entry(name)
        return entry.CRC, entry.file_size

    def read(self, name: str) -> bytes:
        """The bytes of one file.

        Raises:
            ArchiveError: If there is no such file, or it is damaged or larger than it says.
        """
        entry = self._entry(name)
        try:
            with self._file.open(entry) as stream:
                data = stream.read(entry.file_size + 1)
        except _DAMAGE as error:
            raise ArchiveError(f"{self.label}: {name!r} cannot be read: {error}") from error
        if len(data) != entry.file_size:
            raise ArchiveError(
                f"{self.label}: {name!r} holds {len(data)} bytes; its directory says {entry.file_size}"
            )
        return data

    @contextmanager
    def nested(self, name: str) -> Iterator[Self]:
        """The archive that is a file of this one.

        Raises:
            ArchiveError: If it is no zip file, is refused, or lies too deep.
        """
        label = f"{self.label}!{name}"
        if self._depth >= MAX_DEPTH:
            raise ArchiveError(f"{label}: archives lie more than {MAX_DEPTH} deep in each other")
        with _opened(io.BytesIO(self.read(name)), label) as file:
            yield type(self)(file, label, self._depth + 1)

    def _entry(self, name: str) -> zipfile.ZipInfo:
        if name not in self._entries:
            raise ArchiveError(f"{self.label}: no file {name!r} in it")
        return self._entries[name]


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """A zip file on disk, closed at the end.

    Raises:
        ArchiveError: If it is no zip file, or is refused.
    """
    size = path.stat().st_size
    if size > MAX_ARCHIVE_BYTES:
        raise ArchiveError(f"{path.name}: {size} bytes; at most {MAX_ARCHIVE_BYTES} are read")
    with path.open("rb") as stream, _opened(stream, path.name) as file:
        yield Archive(file, path.name)


@contextmanager
def _opened(stream: io.BufferedReader | io.BytesIO, label: str) -> Iterator[zipfile.ZipFile]:
    try:
        file = zipfile.ZipFile(stream)
    except _DAMAGE as error:
        raise ArchiveError(f"{label}: not a zip archive: {error}") from error
    with file:
        yield file


def _checked_entries(file: zipfile.ZipFile, label: str) -> dict[str, zipfile.ZipInfo]:
    infos = file.infolist()
    if len(infos) > MAX_ENTRIES:
        raise ArchiveError(f"{label}: {len(infos)} entries; at most {MAX_ENTRIES} are read")
    entries: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        fault = _fault(info)
        if fault is None and info.filename in entries:
            fault = "stands twice in the directory"
        if fault is not None:
            raise ArchiveError(f"{label}: entry {info.filename!r} {fault}")
        if not info.is_dir():
            entries[info.filename] = info
    total = sum(info.file_size for info in infos)
    if total > MAX_TOTAL_BYTES:
        raise ArchiveError(f"{label}: {total} bytes unpacked; at most {MAX_TOTAL_BYTES} are read")
    return entries


def _fault(info: zipfile.ZipInfo) -> str | None:
    """What is wrong with an entry, as the end of a sentence."""
    return _name_fault(info.orig_filename) or _kind_fault(info) or _size_fault(info)


def _name_fault(name: str) -> str | None:
    path = PurePosixPath(name)
    if path.is_absolute() or name[1:2] == ":":
        return "has an absolute name"
    if ".." in path.parts:
        return "leads out of the archive"
    if "\\" in name or any(ord(c) < ord(" ") for c in name) or not path.parts:
        return "has a name that is no plain path"
    return None


def _kind_fault(info: zipfile.ZipInfo) -> str | None:
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is a link or a device"
    if info.flag_bits & _ENCRYPTED:
        return "is encrypted"
    if info.compress_type not in _METHODS:
        return f"is compressed by method {info.compress_type}; allowed: stored, deflated"
    return None


def _size_fault(info: zipfile.ZipInfo) -> str | None:
    if info.file_size > MAX_ENTRY_BYTES:
        return f"has {info.file_size} bytes; at most {MAX_ENTRY_BYTES} are read"
    if info.file_size > max(RATIO_FREE_BYTES, MAX_RATIO * info.compress_size):
        return (
            f"is {info.file_size} bytes packed into {info.compress_size}; at most {MAX_RATIO} times is read"
        )
    return None
