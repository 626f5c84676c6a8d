"""A folder at a URL, through fsspec. Knows nothing about what lies in it."""

import secrets
from pathlib import Path, PurePosixPath
from typing import Any

from langwm_data.config_io import ConfigError


def is_url(out: str | Path) -> bool:
    """Whether ``out`` is a URL and no path."""
    return "://" in str(out)


class RemoteFolder:
    """A folder that fsspec can open. A file appears in it whole: under another name first, then renamed.

    Where renaming is copying (S3), that costs a copy on the server.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._fs, self._root = _open(url)

    def names(self, folder: str = "") -> dict[str, int]:
        """Size of every file in ``folder``, by its name relative to the root; empty if there is none."""
        self._fs.invalidate_cache()
        try:
            entries = self._fs.ls(self._at(folder), detail=True)
        except FileNotFoundError:
            return {}
        files = [entry for entry in entries if entry["type"] == "file"]
        return {str(PurePosixPath(folder) / Path(entry["name"]).name): entry["size"] for entry in files}

    def entries(self) -> list[str]:
        """Names of all files and folders at the URL; empty if there is nothing."""
        self._fs.invalidate_cache()
        try:
            return [Path(path).name for path in self._fs.ls(self._root, detail=False)]
        except FileNotFoundError:
            return []

    def get(self, name: str, folder: Path) -> None:
        """Copy the file ``name`` to the same place in the local ``folder``, if it is there."""
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        temporary = folder / f"{name}.part"
        try:
            self._fs.get_file(self._at(name), str(temporary))
        except FileNotFoundError:
            temporary.unlink(missing_ok=True)
            return
        temporary.replace(folder / name)

    def put(self, folder: Path, name: str) -> None:
        """Copy the file ``name`` of the local ``folder`` here.

        Raises:
            OSError: If it cannot be written, or arrives with another size; then nothing is there.
        """
        path = PurePosixPath(name)
        temporary = self._at(str(path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")))
        self._fs.makedirs(self._at(str(path.parent)), exist_ok=True)
        self._fs.put_file(str(folder / name), temporary)
        sent, arrived = (folder / name).stat().st_size, self._fs.size(temporary)
        if sent != arrived:
            self._fs.rm_file(temporary)
            raise OSError(
                f"{self.url}/{name}: {arrived} of {sent} bytes arrived; give the same command again"
            )
        self._fs.mv(temporary, self._at(name))

    def remove(self, name: str) -> None:
        """Remove a file or a folder with all that is in it, where it is there."""
        self._fs.invalidate_cache()
        try:
            self._fs.rm(self._at(name), recursive=True)
        except FileNotFoundError:
            return

    def _at(self, name: str) -> str:
        return str(PurePosixPath(self._root) / name)


def _open(url: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError as error:
        raise ConfigError(
            f"--out {url!r} is a URL, which needs the package fsspec: pip install fsspec"
        ) from error
    try:
        return fsspec.core.url_to_fs(url.rstrip("/"))
    except (ImportError, ValueError) as error:
        raise ConfigError(f"--out {url!r} cannot be opened: {error}") from error
