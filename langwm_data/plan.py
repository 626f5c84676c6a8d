"""What a dataset will consist of: which frame shows which floor, and which shard holds it.

Pure functions of the config. Every frame is described by its split and number alone, so any worker can
make any frame, in any order, and the bytes stay the same.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.spec import Split
from langwm_data.seeding import make_rng

SPLITS: tuple[Split, ...] = ("train", "test")


@dataclass(frozen=True, kw_only=True)
class ShardTask:
    """Frames ``start`` to ``stop`` (exclusive) of a split, which make one shard."""

    split: Split
    number: int
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class FramePlan:
    """One frame: where it is taken, and which block of frames it shares its textures with."""

    key: str
    split: Split
    number: int
    block: int
    scene: str


def num_frames(config: DatasetConfig, split: Split) -> int:
    """Frames of one split."""
    num_test = round(config.frames * config.splits.test_fraction)
    return num_test if split == "test" else config.frames - num_test


def plan_shards(config: DatasetConfig) -> list[ShardTask]:
    """All shards of the dataset, in the order in which its index lists them."""
    size = config.shards.samples_per_shard
    tasks = []
    for split in SPLITS:
        total = num_frames(config, split)
        for number, start in enumerate(range(0, total, size)):
            tasks.append(ShardTask(split=split, number=number, start=start, stop=min(start + size, total)))
    return tasks


def parse_shards(text: str) -> range:
    """``0-99`` or ``7`` as the numbers of shards, both ends included.

    Raises:
        ConfigError: If the text is not of that form.
    """
    match = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise ConfigError(f"--shards {text!r} is not of the form 0-99 or 7")
    return range(first, last + 1)


def tasks_in_range(config: DatasetConfig, shards: range) -> list[ShardTask]:
    """The shards with these numbers, counted over all splits; those past the last one are left out.

    Raises:
        ConfigError: If not one of them is there.
    """
    tasks = plan_shards(config)
    if shards.start >= len(tasks):
        raise ConfigError(
            f"--shards {shards.start}-{shards.stop - 1} names no shard; the dataset has 0 to {len(tasks) - 1}"
        )
    return tasks[shards.start : shards.stop]


def plan_frame(config: DatasetConfig, split: Split, number: int) -> FramePlan:
    """Frame ``number`` of a split."""
    block = number // config.cameras.frames_per_block
    scene = scene_of_block(config, split, block)
    return FramePlan(key=f"{scene}-{number:06d}", split=split, number=number, block=block, scene=scene)


def scene_of_block(config: DatasetConfig, split: Split, block: int) -> str:
    """The floor that a block shows: each floor once, in random order, before any comes again."""
    names = open_scenes(config.scenes, config.splits.holds_out).names(split)
    turn, place = divmod(block, len(names))
    return names[_order(config.seed, split, turn, len(names))[place]]


@lru_cache(maxsize=256)
def _order(seed: int, split: Split, turn: int, num: int) -> tuple[int, ...]:
    return tuple(make_rng(seed, "scenes", split, turn).permutation(num).tolist())


def scenes_needed(config: DatasetConfig) -> list[str]:
    """Names of the floors that the dataset shows."""
    return scenes_of(config, plan_shards(config))


def scenes_of(config: DatasetConfig, tasks: Sequence[ShardTask]) -> list[str]:
    """Names of the floors that these shards show."""
    per_block = config.cameras.frames_per_block
    needed = {
        scene_of_block(config, split, block)
        for split in SPLITS
        for block in {
            block
            for task in tasks
            if task.split == split
            for block in range(task.start // per_block, (task.stop - 1) // per_block + 1)
        }
    }
    return sorted(needed)
