"""The files of somebody's copy of a dataset: read whole, within limits, and never outside of its folder.

Owns paths, limits and digests. What the bytes mean is the business of others.
"""

import hashlib
import json
import logging
import os
import posixpath
from functools import cached_property
from pathlib import Path
from typing import Any

from langwm_data import atomic
from langwm_data.scenes.assets import cache_folder

MAX_TEXT_BYTES = 2**24
"""Of a URDF, JSON or TXT file."""
MAX_FILE_BYTES = 2**28
MAX_FILES = 1_000_000

_READ = (".urdf", ".obj", ".mtl", ".json", ".txt", ".png", ".jpg", ".jpeg")
_PASSED_OVER = ("visualizations", "scene_instances")
"""Folders of films and of files that the igibson package writes."""

_logger = logging.getLogger(__name__)


class DataFolder:
    """One folder; paths in it are written with slashes, relative to it."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()

    def has(self, path: str) -> bool:
        """Whether there is a file ``path``."""
        return self._place(path).is_file()

    def has_folder(self, path: str) -> bool:
        """Whether there is a folder ``path``."""
        return self._place(path).is_dir()

    def folders(self, path: str) -> list[str]:
        """Names of the folders in a folder, sorted.

        Raises:
            ValueError: If there is no such folder.
        """
        place = self._place(path)
        if not place.is_dir():
            raise ValueError(f"{path}: no such folder in {self.root}")
        return sorted(entry.name for entry in place.iterdir() if entry.is_dir())

    def read(self, path: str, max_bytes: int = MAX_FILE_BYTES) -> bytes:
        """The bytes of a file.

        Raises:
            ValueError: If there is no such file, it is too large or lies elsewhere.
        """
        place = self._place(path)
        if not place.is_file():
            raise ValueError(f"{path}: no such file in {self.root}")
        size = place.stat().st_size
        if size > max_bytes:
            raise ValueError(f"{path}: {size} bytes; at most {max_bytes} are read")
        return place.read_bytes()

    def read_json(self, path: str) -> Any:  # noqa: ANN401
        """The content of a JSON file.

        Raises:
            ValueError: If it is damaged, or as ``read``.
        """
        try:
            return json.loads(self.read(path, MAX_TEXT_BYTES), parse_constant=_no_number)
        except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ValueError(f"{path}: damaged JSON: {error}") from error

    def read_lines(self, path: str) -> list[str]:
        """The lines of a text file, without blanks around them.

        Raises:
            ValueError: If it is no UTF-8, or as ``read``.
        """
        try:
            return [line.strip() for line in self.read(path, MAX_TEXT_BYTES).decode().splitlines()]
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: not UTF-8 text: {error}") from error

    def beside(self, path: str, name: str) -> str:
        """The path of what a file calls ``name``, relative to the folder that the file lies in.

        Raises:
            ValueError: If that leads out of the dataset.
        """
        plain = name.replace("\\", "/")
        joined = posixpath.normpath(posixpath.join(posixpath.dirname(path), plain))
        if _leads_out(plain, joined):
            raise ValueError(f"{path}: names {name[:200]!r}, which leads out of the dataset")
        return joined

    def digest(self, path: str) -> str:
        """SHA-256 of a file that was there when this folder was opened."""
        digest = self._digests.get(path)
        if digest is None:
            raise ValueError(f"{path}: no such file in {self.root}")
        return digest

    @cached_property
    def identity(self) -> str:
        """SHA-256 over names and contents of all files that scenes may be made from.

        Dates and the place of the dataset do not matter, so copies on different machines are the same.
        """
        listing = "".join(f"{digest}  {path}\n" for path, digest in sorted(self._digests.items()))
        return hashlib.sha256(listing.encode("utf-8", "surrogatepass")).hexdigest()

    @cached_property
    def _digests(self) -> dict[str, str]:
        """By path. What was hashed before is not read again for as long as its size and date stay."""
        note = cache_folder() / "digests" / f"{hashlib.sha256(str(self.root).encode()).hexdigest()}.json"
        known = _read_note(note)
        if not known:
            _logger.info("reading all files of %s once, to know them again", self.root)
        now: dict[str, list[str]] = {}
        for place, path in self._files():
            status = place.stat()
            mark = f"{status.st_size} {status.st_mtime_ns}"
            before = known.get(path)
            digest = before[1] if before and before[0] == mark else _sha256(place)
            now[path] = [mark, digest]
        if now != known:
            atomic.write_json(note, now, indent=None)
        return {path: digest for path, (_, digest) in now.items()}

    def _files(self) -> list[tuple[Path, str]]:
        found = []
        for folder, names, files in os.walk(self.root):
            names[:] = [name for name in names if name not in _PASSED_OVER]
            for name in files:
                if name.lower().endswith(_READ):
                    path = (Path(folder) / name).relative_to(self.root).as_posix()
                    found.append((self._place(path), path))
            if len(found) > MAX_FILES:
                raise ValueError(f"{self.root}: more than {MAX_FILES} files")
        return found

    def _place(self, path: str) -> Path:
        joined = posixpath.normpath(path)
        if _leads_out(path, joined):
            raise ValueError(f"{path[:200]!r} leads out of the dataset")
        place = (self.root / joined).resolve()
        if not place.is_relative_to(self.root):
            raise ValueError(f"{path}: a link that leads out of the dataset")
        return place


def plain_name(name: str, label: str) -> str:
    """A name that is to become part of a path, unless it holds more than a name.

    Raises:
        ValueError: If it is empty or no plain name.
    """
    if not name or name in (".", "..") or any(c in "/\\:" or ord(c) < ord(" ") for c in name):
        raise ValueError(f"{label}: {name[:200]!r} is no plain name")
    return name


def _leads_out(path: str, joined: str) -> bool:
    return path.startswith("/") or path[1:2] == ":" or "\0" in path or joined.split("/")[0] == ".."


def _no_number(text: str) -> float:
    raise json.JSONDecodeError(f"{text} is no number", text, 0)


def _read_note(note: Path) -> dict[str, list[str]]:
    """What a run before found; nothing where the note is missing or damaged."""
    try:
        known = json.loads(note.read_bytes())
        return {str(path): [str(mark), str(digest)] for path, (mark, digest) in known.items()}
    except FileNotFoundError:
        return {}
    except (ValueError, AttributeError, TypeError) as error:
        _logger.warning("all files are read again, as %s is damaged: %s", note, error)
        return {}


def _sha256(place: Path) -> str:
    with place.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
