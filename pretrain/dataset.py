"""Frames of a rendered dataset for training, in an order that depends on seed and step alone.

Owns reading and ordering. What is done to frames afterwards stands in ``update``.
"""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from langwm_data.config_io import ConfigError
from langwm_data.scenes.spec import Split
from langwm_data.seeding import make_rng
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.sample import to_metres, to_millimetres
from pretrain.frames import FrameBatch, FrameObject
from pretrain.model_file import Intrinsics

_BYTES_PER_PIXEL = 3 + 2


class FrameDataset:
    """One split of a dataset as batches of frames.

    Frames are decoded on first use and kept, colours in 8 bits and depth in whole millimetres, until
    ``ram_mib`` is full; the others are read each time.

    Args:
        shards: The frames to use.
        size: Height and width that the model reads.
        ram_mib: Memory for decoded frames.

    Raises:
        ConfigError: If the frames are of another size, or there are none.
    """

    def __init__(self, shards: ShardDataset, size: tuple[int, int], ram_mib: int) -> None:
        camera = shards.manifest.camera
        found = (camera.height, camera.width)
        if found != size:
            raise ConfigError(
                f"--data {str(shards.path)!r} has frames of {found[0]}x{found[1]};"
                f" mae.height and mae.width ask for {size[0]}x{size[1]}"
            )
        if not len(shards):
            raise ConfigError(f"--data {str(shards.path)!r} has no frames to train on")
        self.shards = shards
        """The frames with everything that is known of them."""
        self._images = shards.only("rgb", "depth")
        self.objects = _objects_by_frame(shards)
        """Per frame, the objects that may be hidden."""
        num_kept = min(len(shards), ram_mib * 2**20 // (size[0] * size[1] * _BYTES_PER_PIXEL))
        self._rgb = np.empty((num_kept, *size, 3), dtype=np.uint8)
        self._depth_mm = np.empty((num_kept, *size), dtype=np.uint16)
        self._is_held = np.zeros(num_kept, dtype=np.bool_)

    def __len__(self) -> int:
        return len(self.shards)

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the camera."""
        first, second, third = ((row[0], row[1], row[2]) for row in self.shards.manifest.camera.K)
        return first, second, third

    @property
    def keys(self) -> list[str]:
        """Names of the frames."""
        return self.shards.keys

    def batch(self, numbers: Sequence[int]) -> FrameBatch:
        """The frames of these numbers, in this order."""
        frames = [self._read(number) for number in numbers]
        return FrameBatch(
            rgb=np.stack([rgb for rgb, _ in frames]),
            depth=to_metres(np.stack([depth for _, depth in frames])),
            objects=[self.objects[number] for number in numbers],
            reward=np.zeros(len(frames), dtype=np.float32),
            has_reward=np.zeros(len(frames), dtype=np.bool_),
        )

    def _read(self, number: int) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        if number < len(self._is_held) and self._is_held[number]:
            return self._rgb[number], self._depth_mm[number]
        images = self._images[number]
        rgb, depth_mm = images["rgb"], to_millimetres(images["depth"])
        if number < len(self._is_held):
            self._rgb[number], self._depth_mm[number] = rgb, depth_mm
            self._is_held[number] = True
        return rgb, depth_mm


def open_split(path: Path, split: Split, size: tuple[int, int], ram_mib: int) -> FrameDataset | None:
    """One split of the dataset at ``path``; ``None`` if it was rendered without that split.

    Raises:
        ConfigError: If there is no dataset, or its frames are of another size.
    """
    shards = ShardDataset(path)
    if split not in shards.manifest.splits:
        return None
    return FrameDataset(shards.select(split=split), size, ram_mib)


def batch_numbers(seed: int, step: int, batch_size: int, num_frames: int) -> list[int]:
    """Which frames step ``step`` trains on: epochs follow each other, each shuffled anew."""
    numbers: list[int] = []
    position = step * batch_size
    while len(numbers) < batch_size:
        epoch, start = divmod(position + len(numbers), num_frames)
        order = make_rng(seed, "epoch", epoch).permutation(num_frames)
        numbers += order[start : start + batch_size - len(numbers)].tolist()
    return numbers


def _objects_by_frame(shards: ShardDataset) -> list[list[FrameObject]]:
    """The objects that have a caption: those that stage one found worth naming."""
    table = shards.objects
    same = ("category", "phrase", "center_x", "distance_m", "instance", "model")
    rows = table.select([*same, "key", "x1", "y1", "x2", "y2", "captions"]).to_pylist()
    found: dict[str, list[FrameObject]] = defaultdict(list)
    for row in rows:
        if row["captions"]:
            box = (row["x1"], row["y1"], row["x2"], row["y2"])
            found[row["key"]].append(FrameObject(bbox_xyxy=box, **{name: row[name] for name in same}))
    return [found[key] for key in shards.keys]
