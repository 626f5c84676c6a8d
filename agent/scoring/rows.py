"""A row per episode: what stands in one, and how rows get to disk one by one and back.

Rows are appended to a journal as episodes end, so that a kill loses no more than the running ones; at the end
they become ``episodes.parquet``. A row knows the task it is about and who played, by checksums: rows are
found again by them, and nothing is counted twice.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float64

from agent.envs.episodes import Episode
from agent.envs.outcomes import EpisodeRecord, Outcome
from langwm_data import atomic

EPISODES_FILE = "episodes.parquet"
JOURNAL_FOLDER = ".rows"
LOCK_FILE = ".lock"

Row = dict[str, Any]
"""An episode's entry for each column; ``trajectory`` is as Arrow holds it, in a seventh of the memory of the
lists that its ``as_py()`` gives; everything else is plain Python."""

_TRAJECTORY = pa.list_(pa.list_(pa.float64()))
_NUMBERS = ("spl", "soft_spl", "distance_to_goal", "path_length", "geodesic_distance")
_SCHEMA = pa.schema(
    [pa.field(name, pa.string()) for name in ("system", "split", "scene")]
    + [pa.field(name, pa.int64()) for name in ("tier", "episode")]
    + [pa.field("success", pa.bool_())]
    + [pa.field(name, pa.float64()) for name in _NUMBERS]
    + [pa.field(name, pa.int64()) for name in ("collisions", "length")]
    + [pa.field(name, pa.float64()) for name in ("collision_rate", "return")]
    + [pa.field("is_terminated", pa.bool_())]
    + [pa.field("trajectory", _TRAJECTORY), pa.field("goal", pa.list_(pa.float64()))]
    + [pa.field(name, pa.string()) for name in ("task", "player")]
)


def make_row(record: Outcome, **names: str | int) -> Row:
    """How an episode went, with the names under which it is found again.

    Args:
        record: Of the finished episode of PointGoal navigation.
        names: ``system``, ``split``, ``episode`` (its number on its floor), ``task`` and ``player``.
    """
    assert isinstance(record, EpisodeRecord), "fixed episodes are of PointGoal navigation"
    row: Row = asdict(record) | names
    row |= {"trajectory": _compact(record.trajectory), "goal": record.goal.tolist()}
    row["length"] = row.pop("num_steps")
    row["return"] = row.pop("total_reward")
    row["collision_rate"] = row["collisions"] / row["length"]
    row["success"] = bool(row["success"])
    return {name: row[name] for name in _SCHEMA.names}


def task_of(episode: Episode) -> str:
    """Checksum of what is to be done in an episode."""
    return checksum(json.dumps(episode.to_dict(), sort_keys=True))


def checksum(*texts: str) -> str:
    """Sixteen hexadecimal digits."""
    return hashlib.sha256("\x1f".join(texts).encode()).hexdigest()[:16]


def key_of(row: Row) -> tuple[str, str, str, int]:
    """Under what a row is unique in a folder."""
    return row["system"], row["split"], row["scene"], row["episode"]


def write_table(out: Path, rows: Sequence[Row]) -> None:
    """Write ``episodes.parquet``."""
    with atomic.atomic_path(out / EPISODES_FILE) as temporary:
        pq.write_table(pa.Table.from_pylist(list(rows), schema=_SCHEMA), temporary)


def read_rows(out: Path, columns: Sequence[str] | None = None) -> list[Row]:
    """The rows of ``episodes.parquet``; none where there is no such file.

    Args:
        out: Folder of the evaluation.
        columns: Those that are wanted, as far as the file has them; all when None.

    Raises:
        ValueError: If it cannot be read.
    """
    path = out / EPISODES_FILE
    if not path.is_file():
        return []
    try:
        known = pq.read_schema(path).names
        table = pq.read_table(path, columns=[name for name in columns or known if name in known])
    except pa.ArrowException as error:
        raise ValueError(f"{path} cannot be read: {error}; remove it to score again") from error
    held = {
        name: list(column.cast(_TRAJECTORY)) if name == "trajectory" else column.to_pylist()
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    return [dict(zip(held, values, strict=True)) for values in zip(*held.values(), strict=True)]


class Journal:
    """Rows on their way into the table: a file of lines for every process that writes.

    Args:
        out: The folder of the evaluation.
    """

    def __init__(self, out: Path) -> None:
        self._folder = out / JOURNAL_FOLDER
        self._path: Path | None = None

    def append(self, row: Row) -> None:
        """Add a row; it is on disk when this returns."""
        if self._path is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._path = self._folder / f"{secrets.token_hex(8)}.jsonl"
        with self._path.open("ab") as file:
            file.write(json.dumps(row | {"trajectory": row["trajectory"].as_py()}).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())

    def read(self) -> list[Row]:
        """Whole rows of all processes; one that a kill cut off is none."""
        return [row for path in sorted(self._folder.glob("*.jsonl")) for row in _whole_rows(path)]

    def remove(self) -> None:
        """Forget all rows, once they stand elsewhere."""
        for path in self._folder.glob("*.jsonl"):
            path.unlink()
        with contextlib.suppress(OSError):
            self._folder.rmdir()


def _whole_rows(path: Path) -> Iterable[Row]:
    for line in path.read_bytes().splitlines(keepends=True):
        with contextlib.suppress(ValueError):
            row = json.loads(line) if line.endswith(b"\n") else None
            if isinstance(row, dict) and set(row) == set(_SCHEMA.names):
                yield row | {"trajectory": _compact(np.array(row["trajectory"]))}


def _compact(trajectory: Float64[np.ndarray, "T D"]) -> pa.ListScalar:
    length, dim = trajectory.shape
    poses = pa.ListArray.from_arrays(np.arange(length + 1, dtype=np.int32) * dim, trajectory.ravel())
    return pa.ListArray.from_arrays([0, length], poses)[0]


@contextlib.contextmanager
def claimed(out: Path) -> Iterator[None]:
    """Keep other processes from scoring into the same folder.

    Raises:
        ValueError: If one does so now.
    """
    out.mkdir(parents=True, exist_ok=True)
    with (out / LOCK_FILE).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ValueError(f"another process is scoring into {str(out)!r}; wait for it") from error
        yield
