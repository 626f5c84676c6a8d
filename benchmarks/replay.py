"""Replay of the paper's length: memory of its index, time to open it again, time of one batch.

The index depends on the number of steps and episodes, not on the size of pictures, so these are small there.
Reading is measured on frames of 128 x 160, beside two other ways to read the same files: a memory map of each
that is kept, and safetensors' own ``safe_open`` for each draw. Times are CPU times of one thread, medians of
rounds in turn, with the files in the page cache.

    python -m benchmarks.replay [--steps 300000] [--mean-length 25]
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors import safe_open

from agent.config import ReplayConfig
from agent.replay import Replay, ReplayEpisode, step_bytes
from agent.replay.files import read_entry

MIB = 2**20
EPISODES, LENGTH, SIZE = 12, 300, (128, 160)
"""Of the buffer that is read from."""
FRAMES, DRAWS = 4, 128
"""Of one batch of transitions."""


def make_episode(length: int, size: tuple[int, int], rng: np.random.Generator) -> ReplayEpisode:
    return ReplayEpisode(
        rgb=rng.integers(0, 256, (length, *size, 3), np.uint8),
        task=np.zeros((length, 4), np.float32),
        action=np.zeros((length, 2), np.float32),
        reward=np.zeros(length, np.float32),
        is_terminal=True,
    )


def resident(kind: str = "VmRSS") -> float:
    """MiB of memory of this process; ``RssFile`` is the part that maps of files take."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{kind}:"))


def measure_index(folder: Path, steps: int, mean_length: int, rng: np.random.Generator) -> None:
    config = ReplayConfig(capacity_steps=steps)
    before, replay, count = resident(), Replay(config, folder), 0
    while count < steps:
        length = min(500, 1 + int(rng.geometric(1 / mean_length)))
        replay.add(make_episode(length, (8, 10), rng))
        count += length
    print(f"index: {replay.num_steps} steps in {replay.num_episodes} episodes")
    state = replay.state_dict()
    print(f"  memory: {resident() - before:.0f} MiB more than before, {resident():.0f} MiB in all")
    del replay
    start, before = time.process_time(), resident()
    replay = Replay(config, folder, state)
    print(f"  opened again in {time.process_time() - start:.1f} s of CPU time")
    for draw in range(20):
        replay.sample(np.random.default_rng(draw), 16, 50)
        replay.transitions(np.random.default_rng(draw), 128, 3)
    print(
        f"  after twenty batches of each kind: {resident():.0f} MiB in all, peak {resident('VmHWM'):.0f} MiB"
    )


def median_ms(reads: dict[str, Callable[[np.random.Generator], object]], rounds: int = 9) -> dict[str, float]:
    times: dict[str, list[float]] = {name: [] for name in reads}
    for number in range(rounds):
        for name, read in reads.items():
            start = time.process_time()
            read(np.random.default_rng(number))
            times[name].append(1000 * (time.process_time() - start))
    return {name: statistics.median(found) for name, found in times.items()}


def measure_reading(folder: Path, rng: np.random.Generator) -> None:
    replay = Replay(ReplayConfig(), folder)
    for _ in range(EPISODES):
        replay.add(make_episode(LENGTH, SIZE, rng))
    paths = sorted(folder.glob("episode-*"))
    offsets = {path: read_entry(path).columns["rgb"].offset for path in paths}
    maps: dict[Path, np.ndarray] = {}
    shape = (DRAWS, FRAMES, *SIZE, 3)
    frame = int(np.prod(shape[2:]))

    def by_kept_map(rng: np.random.Generator) -> None:
        out = np.empty(shape, np.uint8)
        for row in out:
            path, first = paths[rng.integers(EPISODES)], int(rng.integers(LENGTH - FRAMES))
            if path not in maps:
                maps[path] = np.memmap(path, mode="r")
            start = offsets[path] + first * frame
            row.reshape(-1)[:] = maps[path][start : start + FRAMES * frame]

    def by_safe_open(rng: np.random.Generator) -> None:
        out = np.empty(shape, np.uint8)
        for row in out:
            path, first = paths[rng.integers(EPISODES)], int(rng.integers(LENGTH - FRAMES))
            with safe_open(path, framework="np") as file:
                row[:] = file.get_slice("rgb")[first : first + FRAMES]

    ours = {
        "sample(16, 50)": lambda rng: replay.sample(rng, 16, 50),
        "transitions(128, 3)": lambda rng: replay.transitions(rng, DRAWS, FRAMES - 1),
    }
    print(f"reading at {SIZE[0]} x {SIZE[1]}, {EPISODES} episodes of {LENGTH} steps, CPU time of a batch:")
    for name, value in median_ms(ours).items():
        print(f"  {name}: {value:.1f} ms")
    print(f"  memory: {resident('RssFile'):.0f} MiB of it maps of files")
    others = {"kept maps": by_kept_map, "safe_open a draw": by_safe_open}
    for name, value in median_ms(others).items():
        print(f"  the frames of these transitions by {name}: {value:.1f} ms")
    print(f"  memory: {resident('RssFile'):.0f} MiB of it maps of files")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--mean-length", type=int, default=25)
    asked = parser.parse_args()
    for with_depth, what in ((False, "RGB and numbers"), (True, "also depth and objects")):
        size = step_bytes(*SIZE, 6, with_depth=with_depth, with_objects=with_depth)
        print(
            f"disk: {size} bytes a step ({what}), {asked.steps * size / 1e9:.1f} GB for {asked.steps} steps"
        )
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        measure_index(Path(folder), asked.steps, asked.mean_length, rng)
    with tempfile.TemporaryDirectory() as folder:
        measure_reading(Path(folder), rng)


if __name__ == "__main__":
    main()
