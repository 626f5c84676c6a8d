"""What is kept of a cell beside its run: how it ended, what it took, on which machine."""

import json
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import torch

from agent.benchmark.grid import Cell
from langwm_data import atomic
from langwm_data.config_io import ConfigError
from pretrain.precision import has_bf16

State = Literal["unfinished", "done", "failed"]
SAVE_EVERY_S = 10.0
"""Time that a killed cell forgets to have spent, at most."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """The state of one cell."""

    state: State = "unfinished"
    cause: str = ""
    """One sentence, where it failed."""
    details: str = ""
    """Where in the program it failed."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Spent on ``train`` and ``score``, work that was done twice after a kill included."""
    cpu_seconds: dict[str, float] = field(default_factory=dict)
    """The same by the clock of the processor, of the cell's own process."""
    scored: dict[str, int] = field(default_factory=dict)
    """Episodes on each floor by split, where all are played."""
    updates: int = 0
    parameters: int = 0
    """Of the model as it is saved, frozen ones included."""
    machine: dict[str, Any] = field(default_factory=dict)


def record_path(out: Path, cell: Cell) -> Path:
    """The file of a cell's record, beside its folder."""
    folder = cell.folder(out)
    return folder.with_name(f"{folder.name}.json")


def read_record(out: Path, cell: Cell) -> Record:
    """The record of a cell; that of one not begun where there is none.

    Raises:
        ConfigError: If the file is damaged.
    """
    path = record_path(out, cell)
    if not path.is_file():
        return Record()
    try:
        return Record(**json.loads(path.read_text("utf-8")))
    except (json.JSONDecodeError, UnicodeDecodeError, TypeError) as error:
        raise ConfigError(f"{path} is damaged; remove it, and the cell is looked at again") from error


def write_record(out: Path, cell: Cell, record: Record) -> None:
    """Replace the record of a cell."""
    atomic.write_json(record_path(out, cell), asdict(record))


class Stopwatch:
    """Adds the time spent on a part of a cell to its record, also while it is being spent.

    Args:
        out: Folder of the grid.
        cell: Whose record.
    """

    def __init__(self, out: Path, cell: Cell) -> None:
        self._out, self._cell = out, cell
        self.record = read_record(out, cell)
        self._saved = -float("inf")

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Count the time inside as ``part``; ``tick`` and the end, whatever it is, save it."""
        self._part = part
        self._start = (time.monotonic(), time.process_time())
        self._before = (self.record.seconds.get(part, 0.0), self.record.cpu_seconds.get(part, 0.0))
        try:
            yield
        finally:
            self._saved = -float("inf")
            self.tick()

    def tick(self) -> None:
        """Save the time spent so far, if that is some time ago."""
        now, spent = time.monotonic(), time.process_time()
        if now - self._saved < SAVE_EVERY_S:
            return
        self._saved = now
        seconds = self.record.seconds | {self._part: self._before[0] + now - self._start[0]}
        cpu = self.record.cpu_seconds | {self._part: self._before[1] + spent - self._start[1]}
        self.update(seconds=seconds, cpu_seconds=cpu)

    def update(self, **changes: Any) -> None:  # noqa: ANN401
        """Change fields of the record and save it."""
        self.record = replace(self.record, **changes)
        write_record(self._out, self._cell, self.record)


def describe_machine(device: str) -> dict[str, Any]:
    """What a cell ran on; only what costs depend on, nothing that tells one computer from another."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    found: dict[str, Any] = {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "memory_gib": round(memory / 2**30, 1),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "bf16": has_bf16(device),
    }
    if device.startswith("cuda"):
        found["gpu"] = torch.cuda.get_device_name(device)
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()
