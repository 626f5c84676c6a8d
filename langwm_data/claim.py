"""The claim on an output folder: whose it is, what of it may be removed, and what is refused.

Owns the ``config.yaml`` that says whose a folder is. What a command writes beside it stands with the command.
"""

import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from langwm_data import atomic
from langwm_data.config_io import (
    CONFIG_FILE,
    ConfigError,
    config_to_dict,
    config_to_yaml,
    differing_fields,
    read_mapping,
)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What the folders of one command have in common."""

    writes: tuple[str, ...]
    """Names of what lies in such a folder beside ``config.yaml``."""
    may_differ: tuple[str, ...] = ()
    """Top-level fields in which a resumed run may differ (how long to train)."""


def claim_output(
    out: Path,
    value: Any,  # noqa: ANN401
    kind: Kind,
    *,
    fresh: bool = False,
    reads: Iterable[str | Path | None] = (),
) -> None:
    """Make ``out`` the folder of this config: write ``config.yaml``, or check the one that is there.

    Several jobs may claim it at once: one writes, the others compare.

    Args:
        out: Folder of the run or dataset.
        value: The resolved config.
        kind: What the command writes.
        fresh: Remove what an earlier run of this command left in ``out`` first.
        reads: Files and folders that the command reads; none of them is removed.

    Raises:
        ConfigError: As ``check_output``.
    """
    reads = tuple(reads)
    check_output(out, value, kind, fresh=fresh, reads=reads)
    if fresh and out.is_dir():
        _empty(out)
    path, text = out / CONFIG_FILE, config_to_yaml(value)
    if not path.is_file() and atomic.create_text(path, text):
        return
    check_output(out, value, kind, reads=reads)  # another job may have been first
    if path.read_text("utf-8") != text:
        atomic.write_text(path, text)


def check_output(
    out: Path,
    value: Any,  # noqa: ANN401
    kind: Kind,
    *,
    fresh: bool = False,
    reads: Iterable[str | Path | None] = (),
) -> None:
    """Refuse what ``claim_output`` would refuse; nothing is changed.

    Raises:
        ConfigError: If ``out`` is a file, holds something that is not of this command, or holds a run of a
            different config; with ``fresh``, if it holds anything that this command did not write, or reads.
    """
    _check_is_folder(out)
    if not _holds_something(out):
        return
    path, new = out / CONFIG_FILE, config_to_dict(value)
    if not path.is_file():
        raise ConfigError(f"--out {str(out)!r} is not empty and holds no {CONFIG_FILE}; give a new folder")
    old = read_mapping(path)
    if set(old) != set(new):
        raise ConfigError(
            f"--out {str(out)!r} holds something else: its {CONFIG_FILE} is not one of this command and"
            " version; give a new folder"
        )
    kept = _must_stay(out, kind, reads)
    if fresh and kept is not None:
        raise ConfigError(f"--fresh would remove {kept}; give a new folder")
    fields = differing_fields(_without(old, kind.may_differ), _without(new, kind.may_differ))
    if fields and not fresh:
        offer = ", the same configuration, or --fresh to start over"
        raise ConfigError(
            f"--out {str(out)!r} holds a run of another configuration: {'; '.join(fields)};"
            f" use another folder{offer if kept is None else ' or the same configuration'}"
        )


def _check_is_folder(out: Path) -> None:
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not there.is_dir():
        where = "is" if there == out else f"lies in {str(there)!r}, which is"
        raise ConfigError(f"--out {str(out)!r} {where} a file; give a folder")


def _holds_something(out: Path) -> bool:
    """Whether there is more in ``out`` than what a job leaves that is only just claiming it."""
    return out.is_dir() and not all(atomic.is_temporary(p.name, CONFIG_FILE) for p in out.iterdir())


def _must_stay(out: Path, kind: Kind, reads: Iterable[str | Path | None]) -> str | None:
    """What in ``out`` starting over must not remove, in words; None where all of it may go."""
    for entry in sorted(out.iterdir()):
        if not _is_written(entry.name, kind):
            return f"{str(entry)!r}, which this command does not write"
    for name in reads:
        if name and os.path.exists(name) and Path(name).resolve().is_relative_to(out.resolve()):
            return f"{str(name)!r}, which this command reads"
    return None


def _is_written(name: str, kind: Kind) -> bool:
    return any(name == own or atomic.is_temporary(name, own) for own in (CONFIG_FILE, *kind.writes))


def _empty(out: Path) -> None:
    """Remove everything in ``out``, and last what says whose it was: a kill leaves no folder of nobody."""
    for entry in sorted(out.iterdir(), key=lambda path: path.name == CONFIG_FILE):
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def _without(values: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}
