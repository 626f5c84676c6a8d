"""Files that are either there whole or not there at all.

Owns the write-to-temporary, fsync, rename pattern that every artefact of the project uses. Knows
nothing about what is written.
"""

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def fsync_dir(folder: Path) -> None:
    """Make a rename inside ``folder`` survive a power cut."""
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


@contextmanager
def atomic_path(path: Path, *, is_durable: bool = True) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; rename it to ``path`` when the block succeeds.

    The temporary file is removed when the block raises, so a full disk leaves what was there. What need not
    survive a power cut, because its reader notices damage, is not ``is_durable`` and waits for no disk.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _temporary(path)
    try:
        yield temporary
        if is_durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
        if is_durable:
            fsync_dir(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def create_text(path: Path, text: str) -> bool:
    """Write ``path`` unless it is there already, whoever else does so at the same time.

    Returns:
        Whether it was written. Of several that create it at once one does; where the file system has no
        hard links the last of them does, and all are told so.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = _temporary(path)
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        try:
            os.link(temporary, path)
        except FileExistsError:
            return False
        except OSError:
            temporary.replace(path)
        fsync_dir(path.parent)
        return True
    finally:
        temporary.unlink(missing_ok=True)


def is_temporary(name: str, of: str) -> bool:
    """Whether ``name`` is that of a file on its way to becoming ``of``, or left by a job that was killed."""
    return name.startswith(f".{of}.") and name.endswith(".tmp")


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")


def write_bytes(path: Path, data: bytes, *, is_durable: bool = True) -> None:
    """Replace ``path`` by ``data``, atomically."""
    with atomic_path(path, is_durable=is_durable) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Replace ``path`` by ``text`` (UTF-8), atomically."""
    write_bytes(path, text.encode())


def write_json(path: Path, value: Any, *, indent: int | None = 2) -> None:  # noqa: ANN401
    """Replace ``path`` by ``value`` as JSON; NaN and infinity are refused."""
    write_text(path, json.dumps(value, indent=indent, allow_nan=False) + "\n")
