"""Speed of reading a dataset: ours at random and in order, webdataset and Hugging Face datasets in order.

All read and decode every file of every sample, in this one process, a block of samples each in turn, so
that what else the machine does slows all alike. Rates are per second of CPU time and per second by the
clock; on an idle machine the two agree.

python benchmarks/reading.py DATA, with DATA from ``langwm render-dataset --preset tiny --frames 1000``.
"""

import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import cv2
import datasets
import numpy as np
import webdataset as wds

from langwm_data import ShardDataset
from langwm_data.shards.sample import FILE_KEYS, decode_sample

BLOCK = 100
ROUNDS = 20
OURS, THEIRS = "ShardDataset, at random", "webdataset, in order"


def shard_paths(data: Path) -> list[str]:
    return [str(data / shard.path) for shard in ShardDataset(data).manifest.shards]


def read_hugging_face(data: Path) -> Iterator[object]:
    rows = datasets.load_dataset(
        "webdataset", data_files={"all": shard_paths(data)}, split="all", streaming=True
    )
    for row in rows:
        yield {name: np.asarray(row[name]) if name.endswith("png") else row[name] for name in FILE_KEYS}


def readers(data: Path) -> dict[str, Callable[[], Iterable[object]]]:
    """What starts an epoch of each reader."""
    dataset, paths = ShardDataset(data), shard_paths(data)

    def webdataset() -> wds.WebDataset:
        return wds.WebDataset(paths, shardshuffle=False)

    return {
        OURS: lambda: dataset.iter(shuffle_seed=0),
        "ShardDataset, in order": lambda: dataset.iter(),
        "ShardDataset, at random, rgb alone": lambda: (
            dataset.only("rgb")[int(n)] for n in np.random.default_rng(0).permutation(len(dataset))
        ),
        THEIRS: lambda: webdataset().decode("rgb8"),
        "webdataset, in order, our decoder": lambda: webdataset().map(decode_sample),
        "Hugging Face streaming, in order": lambda: read_hugging_face(data),
    }


def forever(start: Callable[[], Iterable[object]]) -> Iterator[object]:
    while True:
        yield from start()


def measure(start: dict[str, Callable[[], Iterable[object]]]) -> dict[str, list[tuple[float, float]]]:
    """Per reader and round: samples per second of CPU time, and by the clock."""
    streams = {name: forever(begin) for name, begin in start.items()}
    rates: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for is_counted in (False, *[True] * ROUNDS):
        for name, stream in streams.items():
            cpu, clock = time.process_time(), time.perf_counter()
            for _ in range(BLOCK):
                next(stream)
            rate = BLOCK / (time.process_time() - cpu), BLOCK / (time.perf_counter() - clock)
            if is_counted:
                rates[name].append(rate)
    return rates


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit("give the folder of a dataset: python benchmarks/reading.py DATA")
    data = Path(sys.argv[1])
    cv2.setNumThreads(1)
    datasets.disable_progress_bars()
    manifest = ShardDataset(data).manifest
    num_bytes = sum(shard.bytes for shard in manifest.shards)
    print(f"{manifest.frames} samples, {num_bytes / manifest.frames / 1000:.1f} kB each in the tars")
    print(f"{'samples/s: median (range)':<38}{'of CPU time':>24}{'by the clock':>24}")
    rates = measure(readers(data))
    for name, pairs in rates.items():
        columns = [
            f"{statistics.median(column):7.0f} ({min(column):.0f} to {max(column):.0f})"
            for column in zip(*pairs, strict=True)
        ]
        print(f"{name:<38}{columns[0]:>24}{columns[1]:>24}")
    for place, unit in enumerate(("of CPU time", "by the clock")):
        ratios = [
            ours[place] / theirs[place] for ours, theirs in zip(rates[OURS], rates[THEIRS], strict=True)
        ]
        print(f"{OURS} / {THEIRS}, {unit}: {statistics.median(ratios):.2f}")


if __name__ == "__main__":
    main()
