"""Replay buffer: whole episodes on disk, batches of sequences or of single transitions from them.

Owns the files of past episodes and how steps are drawn. Knows no environment and no model.

Memory holds an index and the columns of a few numbers; everything else stays in one file for each episode
(``files``). At 128x160 a step takes 61,468 bytes of RGB and numbers, or 103,108 with depth and a
dozen objects: the paper's 3e5 steps are 18.4 GB or 30.9 GB. Episodes that were evicted since the last
checkpoint come on top.
"""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Int64

from agent.config import ReplayConfig
from agent.replay.episodes import ReplayBatch, ReplayEpisode, TransitionBatch
from agent.replay.files import FEATURE, read_entry, write_episode
from langwm_data.config_io import ConfigError
from langwm_data.shards.sample import to_metres


def check_disk(folder: Path, *, steps: int, bytes_a_step: int) -> None:
    """Refuse a buffer that will not fit.

    Args:
        folder: Where it will lie; what it holds already counts as room.
        steps: Steps that it will hold at most.
        bytes_a_step: As ``step_bytes`` says.

    Raises:
        ConfigError: If the disk has less room than that.
    """
    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    held = sum(path.stat().st_size for path in folder.glob("episode-*")) if folder.is_dir() else 0
    room, needed = shutil.disk_usage(there).free + held, steps * bytes_a_step
    if needed > room:
        raise ConfigError(
            f"replay.capacity_steps: {steps} steps of {bytes_a_step} bytes take {needed / 1e9:.1f} GB but"
            f" {str(folder)!r} has room for {room / 1e9:.1f} GB; lower it or give another --out"
        )


class Replay:
    """Episodes on disk, first in first out.

    Evicted episodes leave the index at once but keep their files until ``delete_evicted``, so that a
    run can go back to its last checkpoint: save ``state_dict`` in the checkpoint, and call
    ``delete_evicted`` when the checkpoint is complete.

    Args:
        config: Capacity and sampling.
        folder: Holds the files; created if missing.
        state: What ``state_dict`` returned. Episodes stored after it are deleted, for the resumed run
            will collect them again; without it the buffer starts empty.

    Raises:
        ValueError: If an episode of ``state`` is missing or unreadable.
    """

    def __init__(self, config: ReplayConfig, folder: Path, state: Mapping[str, int] | None = None) -> None:
        self._config = config
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._first, self._next = (state["first"], state["next"]) if state else (0, 0)
        self._entries = {n: read_entry(self._path(n)) for n in range(self._first, self._next)}
        self._num_steps = sum(e.length for e in self._entries.values())
        self._ends: Int64[np.ndarray, " N"] | None = None
        """Running number of transitions after each episode; None until it is needed."""
        self._delete(lambda n: not self._first <= n < self._next)

    @property
    def num_episodes(self) -> int:
        """Episodes that can be drawn from."""
        return len(self._entries)

    @property
    def num_steps(self) -> int:
        """Steps in these episodes, resets included."""
        return self._num_steps

    def state_dict(self) -> dict[str, int]:
        """What a checkpoint needs to find this buffer again: the numbers of its episodes."""
        return {"first": self._first, "next": self._next}

    def add(self, episode: ReplayEpisode) -> None:
        """Store a finished episode; the oldest ones leave while the buffer is over its capacity.

        The newest episode always stays. Short ones are welcome: successes are short.

        Raises:
            OSError: If it cannot be written, for instance because the disk is full; the buffer is as it was.
        """
        entry = write_episode(self._path(self._next), episode)
        if self._entries:
            held = self._entries[self._first].columns.keys()
            assert entry.columns.keys() == held, f"all episodes have the same columns: {sorted(held)}"
        self._entries[self._next] = entry
        self._next += 1
        self._num_steps += entry.length
        while len(self._entries) > 1 and self._num_steps > self._config.capacity_steps:
            self._num_steps -= self._entries.pop(self._first).length
            self._first += 1
        self._ends = None

    def delete_evicted(self) -> None:
        """Remove the files of evicted episodes; earlier checkpoints cannot be resumed afterwards."""
        self._delete(lambda n: n not in self._entries)

    def sample(self, rng: np.random.Generator, batch: int, length: int) -> ReplayBatch:
        """Draw ``batch`` rows of exactly ``length`` steps.

        Every row begins in an episode drawn uniformly, at a step drawn uniformly among those with
        ``length`` steps left (the last of them more often with ``prioritize_ends``). An episode that
        is too short is taken whole, and the row goes on with the start of another one.

        Raises:
            ValueError: If no episode has been finished yet.
        """
        if not self._entries:
            raise _nothing_to_draw()
        shapes = self._entries[self._first].step_shapes
        arrays = {name: np.empty((batch, length, *shape), dtype) for name, (dtype, shape) in shapes.items()}
        flags = {k: np.zeros((batch, length), np.bool_) for k in ("is_first", "is_last", "is_terminal")}
        has_objects = "object_offset" in self._entries[self._first].columns
        objects = [self._fill_row(rng, i, arrays, flags, has_objects=has_objects) for i in range(batch)]
        return _as_batch(arrays, flags, objects if has_objects else None)

    def transitions(self, rng: np.random.Generator, batch: int, stack: int) -> TransitionBatch:
        """Draw ``batch`` single steps, uniformly among all that the buffer holds.

        Args:
            rng: Source of the choice.
            batch: How many.
            stack: Frames of one observation.

        Raises:
            ValueError: If no step has been stored yet.
        """
        ends = self._transition_ends()
        if not len(ends) or not ends[-1]:
            raise _nothing_to_draw()
        drawn = rng.integers(ends[-1], size=batch)
        numbers = np.searchsorted(ends, drawn, side="right")
        entries = [self._entries[self._first + int(n)] for n in numbers]
        steps = [int(d - (ends[n] - (e.length - 1))) for d, n, e in zip(drawn, numbers, entries, strict=True)]
        _, shape = entries[0].step_shapes["rgb"]
        rgb = np.empty((batch, stack + 1, *shape), np.uint8)
        for frames, entry, step in zip(rgb, entries, steps, strict=True):
            missing = max(0, stack - 1 - step)
            entry.read({"rgb": frames[missing:]}, step + 1 + missing - stack)
            frames[:missing] = frames[missing]
        pairs = list(zip(entries, steps, strict=True))
        held = {
            "rgb": rgb,
            "task": np.stack([e.task[t : t + 2] for e, t in pairs]),
            "action": np.stack([e.action[t + 1] for e, t in pairs]),
            "reward": np.stack([e.reward[t + 1] for e, t in pairs]),
            "is_terminal": np.array([e.is_terminal and t + 2 == e.length for e, t in pairs]),
        }
        return TransitionBatch(**{name: torch.from_numpy(array) for name, array in held.items()})

    def _transition_ends(self) -> Int64[np.ndarray, " N"]:
        if self._ends is None:
            self._ends = np.cumsum([e.length - 1 for e in self._entries.values()], dtype=np.int64)
        return self._ends

    def _fill_row(
        self,
        rng: np.random.Generator,
        row: int,
        arrays: Mapping[str, np.ndarray],
        flags: Mapping[str, np.ndarray],
        *,
        has_objects: bool,
    ) -> list[list[Any]]:
        """Draw one row into the arrays; its objects."""
        length = arrays["reward"].shape[1]
        objects: list[list[Any]] = []
        start, done = None, 0
        while done < length:
            entry = self._entries[self._first + int(rng.integers(len(self._entries)))]
            if start is None:
                start = self._sample_start(rng, entry.length, length)
            count = min(entry.length - start, length - done)
            place = slice(done, done + count)
            entry.read({name: array[row, place] for name, array in arrays.items()}, start)
            if has_objects:
                objects += entry.read_objects(start, start + count)
            flags["is_first"][row, done] = start == 0
            if start + count == entry.length:
                flags["is_last"][row, done + count - 1] = True
                flags["is_terminal"][row, done + count - 1] = entry.is_terminal
            done += count
            start = 0
        flags["is_first"][row, 0] = True
        return objects

    def _sample_start(self, rng: np.random.Generator, total: int, length: int) -> int:
        latest = max(0, total - length)
        # DreamerV2 draws from `minlen` more starts than there are and clips them to the latest one.
        extra = length if self._config.prioritize_ends else 0
        return min(int(rng.integers(latest + 1 + extra)), latest)

    def _path(self, number: int) -> Path:
        return self._folder / f"episode-{number:08d}.safetensors"

    def _delete(self, is_unwanted: Callable[[int], bool]) -> None:
        for path in self._folder.glob("episode-*.safetensors"):
            if is_unwanted(int(path.stem.removeprefix("episode-"))):
                path.unlink()
        for path in self._folder.glob(".episode-*.tmp"):  # left by a kill in the middle of a write
            path.unlink()


def _nothing_to_draw() -> ValueError:
    return ValueError("the replay buffer is empty; collect at least one whole episode before training")


def _as_batch(
    arrays: Mapping[str, np.ndarray], flags: Mapping[str, np.ndarray], objects: list[list[Any]] | None
) -> ReplayBatch:
    tensors = {name: torch.from_numpy(array) for name, array in {**arrays, **flags}.items()}
    features = {k.removeprefix(FEATURE): v for k, v in tensors.items() if k.startswith(FEATURE)}
    depth = torch.from_numpy(to_metres(arrays["depth_mm"])) if "depth_mm" in arrays else None
    main = {k: v for k, v in tensors.items() if not k.startswith(FEATURE) and k != "depth_mm"}
    return ReplayBatch(**main, depth=depth, objects=objects, features=features)
