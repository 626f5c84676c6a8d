"""Metrics of a run: one JSON line per logged step, and the same in TensorBoard."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch.utils.tensorboard import SummaryWriter

from langwm_data import atomic

METRICS_FILE = "metrics.jsonl"
TENSORBOARD = "tensorboard"


class MetricsLogger:
    """Writes ``RUN/metrics.jsonl`` and ``RUN/tensorboard/``.

    Args:
        run: Folder of the run.
        step: Steps done when the run goes on; anything logged later than that is taken back, so that
            an interrupted run leaves the same lines as an uninterrupted one.
    """

    def __init__(self, run: Path, step: int = 0) -> None:
        self._path = run / METRICS_FILE
        rows = [row for row in read_metrics(run) if row["step"] <= step]
        atomic.write_text(self._path, "".join(json.dumps(row) + "\n" for row in rows))
        self._file = self._path.open("a", encoding="utf-8")
        self._writer = SummaryWriter(str(run / TENSORBOARD), purge_step=step + 1)

    def log(self, step: int, values: Mapping[str, float]) -> None:
        """Add one line; a value that is not finite is written as null."""
        row = {key: float(value) if math.isfinite(value) else None for key, value in values.items()}
        self._file.write(json.dumps({"step": step, **row}) + "\n")
        self._file.flush()
        for key, value in values.items():
            self._writer.add_scalar(key, float(value), step)

    def image(self, step: int, name: str, rgb: NDArray[np.uint8]) -> None:
        """Show an image (H, W, 3) in TensorBoard."""
        self._writer.add_image(name, rgb, step, dataformats="HWC")

    def close(self) -> None:
        """Flush and close both files; a second call does nothing."""
        self._file.close()
        self._writer.close()

    def __enter__(self) -> "MetricsLogger":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def read_metrics(run: Path) -> list[dict[str, Any]]:
    """The lines of ``RUN/metrics.jsonl``; a last line cut short by a crash is left out."""
    path = run / METRICS_FILE
    if not path.is_file():
        return []
    lines = path.read_text("utf-8").split("\n")
    return [json.loads(line) for line in lines[:-1] if line]
