"""Checkpoints: folders that count only once their ``done`` marker exists, which has the state's checksum.

Owns names, atomic writing and safe reading. What a checkpoint holds is the training loop's affair:
tensors, numbers, strings, lists and dicts. Nothing else is ever unpickled.
"""

import io
import pickle
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from typing_extensions import Buffer

from langwm_data import atomic
from langwm_data.shards.writer import sha256_of

CHECKPOINTS = "checkpoints"
SCHEMA_VERSION = 1
_STATE = "state.pt"
_DONE = "done"
_PIECE = 2**20
"""Bytes that are written at once. PyTorch hands over a thousand scraps for one checkpoint."""


def save_checkpoint(run: Path, step: int, state: Mapping[str, Any], *, keep: int = 2) -> Path:
    """Write ``RUN/checkpoints/step-<step>/`` and remove all but the last ``keep`` checkpoints.

    Args:
        run: Folder of the run.
        step: Steps done so far; names the folder.
        state: Everything needed to go on exactly.
        keep: Complete checkpoints that stay.

    Raises:
        OSError: If it cannot be written, for instance because the disk is full; older ones stay, also one
            of the same step.
    """
    folder = run / CHECKPOINTS / f"step-{step:09d}"
    with atomic.atomic_path(folder / _STATE) as temporary:
        _save({"schema_version": SCHEMA_VERSION, "step": step, "state": dict(state)}, temporary)
        checksum = sha256_of(temporary)
        if (folder / _DONE).exists():  # while one of the same step is being replaced, either counts
            atomic.write_text(folder / _DONE, f"{sha256_of(folder / _STATE)} {checksum}")
    atomic.write_text(folder / _DONE, checksum)
    for old in _complete(run)[:-keep]:
        (old / _DONE).unlink()
        shutil.rmtree(old)
    return folder


def latest_checkpoint(run: Path) -> Path | None:
    """The last complete checkpoint of ``run``, if there is one."""
    folders = _complete(run)
    return folders[-1] if folders else None


def load_checkpoint(folder: Path, device: str | torch.device = "cpu") -> tuple[int, dict[str, Any]]:
    """The step and the state that ``save_checkpoint`` wrote.

    Raises:
        ValueError: If the file is damaged, of another schema version, or not one of ours.
    """
    path = folder / _STATE
    try:
        said = (folder / _DONE).read_text("utf-8")  # empty where it was written before there were checksums
        if said and sha256_of(path) not in said.split():
            raise OSError("it was changed after it was written")
        held = torch.load(path, map_location=device, weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise ValueError(f"checkpoint {path} cannot be read; {_way_out(folder)}") from error
    version = held.get("schema_version") if isinstance(held, dict) else None
    if version != SCHEMA_VERSION:
        raise ValueError(
            f"checkpoint {path} has schema version {version}; this program reads {SCHEMA_VERSION}"
        )
    return held["step"], held["state"]


def _way_out(folder: Path) -> str:
    """What to do where the checkpoint in ``folder`` is damaged."""
    if any(other < folder for other in _complete(folder.parents[1])):
        return "remove its folder to use the one before"
    return "there is no earlier one; --fresh starts over"


def _save(value: Mapping[str, Any], path: Path) -> None:
    watched = _Watched(path, "w")
    try:
        with io.BufferedWriter(watched, _PIECE) as file:
            torch.save(value, file)
    except (RuntimeError, OSError) as error:
        if watched.error is None:
            raise
        raise OSError(watched.error.errno, watched.error.strerror, str(path)) from error


class _Watched(io.FileIO):
    """A file that remembers why it could not be written: PyTorch puts an error of its own in its place."""

    error: OSError | None = None

    def write(self, data: Buffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.error = error
            raise


def _complete(run: Path) -> list[Path]:
    return sorted(done.parent for done in (run / CHECKPOINTS).glob(f"step-*/{_DONE}"))
