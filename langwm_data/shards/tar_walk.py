"""Read a shard as strictly as ``writer`` writes it: every header and every padding byte.

Owns what may stand in a tar. Python's ``tarfile`` reads links, devices, sparse files and names of any
form; none of these has a place in a shard, so the headers are compared with what the writer would have
written, and nothing is ever extracted.
"""

import re
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from langwm_data.shards.findings import foreign
from langwm_data.shards.sample import FILE_KEYS, KEY_PATTERN, DatasetError

Read = Callable[[int], bytes]
"""At most so many of the next bytes of a tar; fewer only at its end."""

MAX_FILE_BYTES = 16 << 20
"""Largest file of a sample: more than 2048 x 2048 pixels of noise."""

_NAME = re.compile(rf"({KEY_PATTERN})\.({'|'.join(map(re.escape, FILE_KEYS))})", re.ASCII)
_KINDS = {
    tarfile.LNKTYPE: "a hard link",
    tarfile.SYMTYPE: "a symbolic link",
    tarfile.CHRTYPE: "a device",
    tarfile.BLKTYPE: "a device",
    tarfile.DIRTYPE: "a folder",
    tarfile.FIFOTYPE: "a pipe",
    tarfile.XHDTYPE: "an extended header",
    tarfile.XGLTYPE: "an extended header",
    tarfile.GNUTYPE_LONGNAME: "an extended header",
    tarfile.GNUTYPE_LONGLINK: "an extended header",
    tarfile.GNUTYPE_SPARSE: "a sparse file",
}


@dataclass(frozen=True, kw_only=True)
class Member:
    """One file in a tar."""

    name: str
    offset: int
    """Of its bytes in the tar."""
    data: bytes
    fault: str
    """What is wrong with how it is stored; empty where nothing is."""


@dataclass(kw_only=True)
class RawSample:
    """The undecoded files of one sample, and what is wrong with how they lie in the tar."""

    key: str
    files: dict[str, bytes] = field(default_factory=dict)
    places: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Offset and size of the bytes of each file."""
    faults: list[str] = field(default_factory=list)


def walk_samples(read: Read) -> Iterator[RawSample]:
    """The samples of a shard, one after the other; only one is held at a time.

    Raises:
        DatasetError: Where the tar cannot be read any further.
    """
    sample: RawSample | None = None
    seen: set[str] = set()
    for member in walk_members(read):
        match = _NAME.fullmatch(member.name)
        key = match[1] if match else ascii(member.name.partition(".")[0])[1:-1][:80]
        if sample is None or sample.key != key:
            if sample is not None:
                yield _closed(sample)
            sample = RawSample(key=key)
            if key in seen:
                sample.faults.append("its files are not next to each other, or it is there twice")
            seen.add(key)
        _take(sample, member, match[2] if match else None)
    if sample is not None:
        yield _closed(sample)


def walk_members(read: Read) -> Iterator[Member]:
    """The files of a tar in order, and last a check of its end.

    Raises:
        DatasetError: Where the tar cannot be read any further.
    """
    offset = 0
    while any(header := _read(read, tarfile.BLOCKSIZE, offset)):
        offset += tarfile.BLOCKSIZE
        name, size, fault = _parse_header(header, offset)
        data = _read(read, size, offset)
        padding = _read(read, -size % tarfile.BLOCKSIZE, offset + size)
        if any(padding) and not fault:
            fault = "the space after it is not empty"
        yield Member(name=name, offset=offset, data=data, fault=fault)
        offset += size + len(padding)
    offset += tarfile.BLOCKSIZE
    rest = _read(read, tarfile.BLOCKSIZE + -(offset + tarfile.BLOCKSIZE) % tarfile.RECORDSIZE, offset)
    if any(rest) or read(1):
        raise DatasetError(f"something stands after the end of the tar at byte {offset}")


def _read(read: Read, size: int, offset: int) -> bytes:
    data = read(size)
    if len(data) != size:
        raise DatasetError(f"the tar is cut off at byte {offset + len(data)}")
    return data


def _parse_header(header: bytes, offset: int) -> tuple[str, int, str]:
    """Name, size and what is wrong with the header that ends at ``offset``."""
    try:
        info = tarfile.TarInfo.frombuf(header, "latin-1", "strict")
    except (tarfile.HeaderError, ValueError) as error:
        raise DatasetError(f"the tar header at byte {offset - len(header)} is damaged: {error}") from error
    if not 0 <= info.size <= MAX_FILE_BYTES:
        raise DatasetError(f"file {foreign(info.name)} claims {info.size} bytes; allowed: {MAX_FILE_BYTES}")
    if info.type != tarfile.REGTYPE:
        return info.name, info.size, f"it is {_KINDS.get(info.type, 'not a plain file')}"
    if header != _written_header(info.name, info.size):
        return info.name, info.size, "its tar header is not what the writer writes"
    return info.name, info.size, ""


def _written_header(name: str, size: int) -> bytes:
    info = tarfile.TarInfo(name)
    info.size, info.mode = size, 0o444
    try:
        return info.tobuf(tarfile.USTAR_FORMAT)
    except ValueError:  # a name too long for USTAR
        return b""


def _take(sample: RawSample, member: Member, file_key: str | None) -> None:
    if file_key is None:
        allowed = ", ".join(f"<key>.{name}" for name in FILE_KEYS)
        sample.faults.append(f"name {foreign(member.name)} is not allowed; allowed: {allowed}")
    elif file_key in sample.files:
        sample.faults.append(f"{file_key} is there twice")
    else:
        sample.files[file_key] = member.data
        sample.places[file_key] = member.offset, len(member.data)
    if member.fault:
        sample.faults.append(f"{file_key or foreign(member.name)}: {member.fault}")


def _closed(sample: RawSample) -> RawSample:
    """The sample after its last file: is all of it there, in order?"""
    if missing := [name for name in FILE_KEYS if name not in sample.files]:
        sample.faults.append(f"it lacks {', '.join(missing)}")
    elif tuple(sample.files) != FILE_KEYS:
        sample.faults.append(f"its files lie in the order {', '.join(sample.files)}")
    return sample
