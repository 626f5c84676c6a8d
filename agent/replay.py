"""Replay buffer: whole episodes on disk, chunks of fixed length from them as batches.

Owns the files of past episodes and how chunks are drawn. Knows no environment and no model.

Every finished episode is one safetensors file, written atomically and read by slices, so memory
holds only an index. Images are stored raw, H * W * 5 bytes per step (102 kB at 128x160, 31 GB for the
paper's 3e5 steps): PNGs would take 28 kB, but a batch of 16x50 then costs 1.1 s of CPU instead of 0.2 s.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8, UInt16
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from torch import Tensor

from agent.config import ReplayConfig
from langwm_data import atomic
from langwm_data.shards.sample import to_metres
from pretrain.batch import FrameBatch, FrameObject

SCHEMA_VERSION = 2


@dataclass(frozen=True, kw_only=True)
class ReplayEpisode:
    """One finished episode; step 0 is the reset. ``action[t]`` led to observation t and ``reward[t]``."""

    rgb: UInt8[np.ndarray, "T H W 3"]
    depth_mm: UInt16[np.ndarray, "T H W"]
    """Millimetres, 0 = invalid."""
    task: Float32[np.ndarray, "T F"]
    action: Float32[np.ndarray, "T A"]
    reward: Float32[np.ndarray, " T"]
    objects: Sequence[Sequence[FrameObject]]
    is_terminal: bool
    """Whether the last step ended the episode for good; a timeout does not."""


@dataclass(frozen=True, kw_only=True)
class ReplayBatch:
    """Chunks of episodes. A row may hold several episodes; ``is_first`` marks where each begins."""

    rgb: UInt8[Tensor, "B T H W 3"]
    depth: Float[Tensor, "B T H W"]
    """Metres, 0 = invalid."""
    task: Float[Tensor, "B T F"]
    action: Float[Tensor, "B T A"]
    """``action[:, t]`` led to observation t; zero at a reset."""
    reward: Float[Tensor, "B T"]
    """Received on arriving at observation t."""
    is_first: Bool[Tensor, "B T"]
    """True at a reset and in every row's first step: nothing before it belongs to the row."""
    is_last: Bool[Tensor, "B T"]
    is_terminal: Bool[Tensor, "B T"]
    """The last step of an episode that terminated; False where it was cut off by a timeout."""
    objects: list[list[list[FrameObject]]]
    """Per row and step, the labelled objects; empty lists where the environment gave none."""

    def to(self, device: torch.device | str) -> "ReplayBatch":
        """The same batch with its tensors on ``device``."""
        tensors = {k: v.to(device) for k, v in vars(self).items() if isinstance(v, Tensor)}
        return replace(self, **tensors)

    def frames(self) -> FrameBatch:
        """All steps of all rows as single frames, for finetuning the autoencoder."""
        reward = self.reward.flatten().numpy(force=True)
        return FrameBatch(
            rgb=self.rgb.flatten(0, 1).numpy(force=True),
            depth=self.depth.flatten(0, 1).numpy(force=True),
            objects=[objects for row in self.objects for objects in row],
            reward=reward,
            has_reward=np.ones(len(reward), dtype=np.bool_),
        )


@dataclass(frozen=True)
class _Entry:
    """One stored episode in the index."""

    path: Path
    length: int
    is_terminal: bool
    names: tuple[tuple[str, str], ...]
    """Category and noun of the objects seen in it."""


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
        first, self._next = (state["first"], state["next"]) if state else (0, 0)
        self._entries = {n: _read_entry(self._path(n)) for n in range(first, self._next)}
        self._delete(lambda n: not first <= n < self._next)

    @property
    def num_episodes(self) -> int:
        """Episodes that can be drawn from."""
        return len(self._entries)

    @property
    def num_steps(self) -> int:
        """Steps in these episodes, resets included."""
        return sum(e.length for e in self._entries.values())

    def state_dict(self) -> dict[str, int]:
        """What a checkpoint needs to find this buffer again: the numbers of its episodes."""
        return {"first": self._next - len(self._entries), "next": self._next}

    def add(self, episode: ReplayEpisode) -> None:
        """Store a finished episode; the oldest ones leave while the buffer is over its capacity.

        The newest episode always stays. Short ones are welcome: successes are short.
        """
        path = self._path(self._next)
        self._entries[self._next] = _write_episode(path, episode)
        self._next += 1
        while len(self._entries) > 1 and self.num_steps > self._config.capacity_steps:
            del self._entries[min(self._entries)]

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
            raise ValueError("the replay buffer is empty; collect at least one whole episode before training")
        rows = [self._sample_row(rng, length) for _ in range(batch)]
        arrays = {k: torch.from_numpy(np.stack([r[k] for r in rows])) for k in rows[0] if k != "objects"}
        return ReplayBatch(**arrays, objects=[r["objects"] for r in rows])

    def _sample_row(self, rng: np.random.Generator, length: int) -> dict[str, Any]:
        pieces: list[dict[str, Any]] = []
        start, missing = None, length
        while missing > 0:
            entry = self._entries[min(self._entries) + int(rng.integers(len(self._entries)))]
            if start is None:
                start = self._sample_start(rng, entry.length, length)
            stop = min(entry.length, start + missing)
            pieces.append(_read_chunk(entry, start, stop))
            missing -= stop - start
            start = 0
        arrays = {k: np.concatenate([p[k] for p in pieces]) for k in pieces[0] if k != "objects"}
        arrays["is_first"][0] = True
        return arrays | {"objects": [frame for p in pieces for frame in p["objects"]]}

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


def _write_episode(path: Path, episode: ReplayEpisode) -> _Entry:
    length = len(episode.reward)
    lengths = {len(a) for a in (episode.rgb, episode.depth_mm, episode.task, episode.action, episode.objects)}
    assert lengths == {length}, f"columns of unequal length: {lengths} and {length}"
    flat = [o for frame in episode.objects for o in frame]
    names = tuple(sorted({(o.category, o.phrase) for o in flat}))
    tensors = {
        "rgb": episode.rgb,
        "depth_mm": episode.depth_mm,
        "task": episode.task,
        "action": episode.action,
        "reward": episode.reward,
        "object_offset": np.cumsum([0, *map(len, episode.objects)], dtype=np.int64),
        "object_name": np.array([names.index((o.category, o.phrase)) for o in flat], np.int64),
        "object_box": np.array([o.bbox_xyxy for o in flat], np.float64).reshape(-1, 4),
        "object_center_x": np.array([o.center_x for o in flat], np.float64),
        "object_distance_m": np.array([o.distance_m for o in flat], np.float64),
    }
    header = {"schema_version": SCHEMA_VERSION, "is_terminal": episode.is_terminal, "names": names}
    with atomic.atomic_path(path) as temporary:
        contiguous = {k: np.ascontiguousarray(v) for k, v in tensors.items()}
        save_file(contiguous, temporary, metadata={"replay": json.dumps(header)})
    return _Entry(path, length, episode.is_terminal, names)


def _read_entry(path: Path) -> _Entry:
    try:
        with safe_open(path, framework="np") as file:
            header = json.loads(file.metadata()["replay"])
            length = file.get_slice("reward").get_shape()[0]
    except (OSError, SafetensorError, TypeError, KeyError, ValueError) as error:
        raise ValueError(
            f"{path} of the replay buffer is missing or damaged ({error}); start the run over with --fresh"
        ) from error
    if header["schema_version"] != SCHEMA_VERSION:
        raise ValueError(f"{path} has schema version {header['schema_version']}; known: {SCHEMA_VERSION}")
    return _Entry(
        path, length, header["is_terminal"], tuple((category, noun) for category, noun in header["names"])
    )


def _read_chunk(entry: _Entry, start: int, stop: int) -> dict[str, Any]:
    """Steps ``start`` to ``stop`` (exclusive) of one episode."""
    steps = np.arange(start, stop)
    with safe_open(entry.path, framework="np") as file:
        chunk = {k: file.get_slice(k)[start:stop] for k in ("rgb", "task", "action", "reward")}
        depth_mm = file.get_slice("depth_mm")[start:stop]
        offset = file.get_slice("object_offset")[start : stop + 1]
        columns = [
            file.get_tensor(f"object_{k}")[offset[0] : offset[-1]].tolist()
            for k in ("name", "box", "center_x", "distance_m")
        ]
    flat = [
        FrameObject(
            category=entry.names[n][0],
            phrase=entry.names[n][1],
            bbox_xyxy=tuple(box),
            center_x=x,
            distance_m=d,
        )
        for n, box, x, d in zip(*columns, strict=True)
    ]
    is_last = steps == entry.length - 1
    return chunk | {
        "depth": to_metres(depth_mm),
        "is_first": steps == 0,
        "is_last": is_last,
        "is_terminal": is_last & entry.is_terminal,
        "objects": [flat[a - offset[0] : b - offset[0]] for a, b in pairwise(offset)],
    }
