"""One rendering job killed again and again, and the same job in other ways: are the datasets the same bytes?

First the job runs undisturbed. Then, in another folder, its whole process group is killed with SIGKILL at
random moments and started again, and in the end left to finish. Then it runs as four ranges of shards at
once, and through Ray where that is installed. Every file of every folder is compared.

python benchmarks/kills.py --out DIR [--kills 50] [--frames 5000] [--workers 2] [--seed 0]
    [--ways killed ranges ray] [--preset NAME] [--set a.b=v]
"""

import argparse
import importlib.util
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from langwm_data.config import DatasetConfig
from langwm_data.config_io import load_config
from langwm_data.plan import plan_shards
from langwm_data.shards.verify import verify_dataset
from langwm_data.shards.writer import sha256_of

RANGES = 4
WAYS = ("killed", "ranges", "ray")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One call of ``langwm render-dataset``, but for where it writes."""

    arguments: tuple[str, ...]
    workers: int
    num_shards: int

    def start(self, out: Path, *more: str) -> subprocess.Popen[bytes]:
        """Begin it, or go on with it, in a process group of its own."""
        root = Path(__file__).resolve().parent.parent
        command = [sys.executable, str(root / "cli.py"), "render-dataset", "--out", str(out)]
        return subprocess.Popen(
            [*command, *self.arguments, *more],
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root), "LANGWM_LOG": "WARNING"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def run(self, out: Path, *more: str) -> float:
        """Do it to its end; the seconds that it took."""
        start = time.perf_counter()
        finish(self.start(out, *more))
        return time.perf_counter() - start

    @property
    def on_this_machine(self) -> tuple[str, ...]:
        """The flag for its workers."""
        return ("--workers", str(self.workers))


def finish(process: subprocess.Popen[bytes]) -> None:
    """Wait for a job.

    Raises:
        SystemExit: If it fails; what it said is passed on.
    """
    _, said = process.communicate()
    if process.returncode:
        raise SystemExit(f"a job failed with exit code {process.returncode}: {said.decode()}")


def kill_and_restart(
    job: Job, out: Path, kills: int, undisturbed_s: float, rng: np.random.Generator
) -> list[Path]:
    """Kill a job at random moments, spread over all of it, until it was killed so often; then let it finish.

    Where it is done before that, it starts over in a new folder.

    Returns:
        The folders that it wrote, mostly one.
    """
    startup_s = job.run(out.with_name("whole"), *job.on_this_machine)  # finds nothing to do
    folders, killed = [out], 0
    while killed < kills:
        process = job.start(folders[-1], *job.on_this_machine)
        left_s = undisturbed_s * (1 - count_shards(folders[-1]) / job.num_shards)
        delay_s = float(rng.uniform(0, 2) * (startup_s + left_s / (kills - killed + 1)))
        try:
            process.communicate(timeout=delay_s)
        except subprocess.TimeoutExpired:
            kill_group(process)
            killed += 1
            shards = f"{count_shards(folders[-1])} of {job.num_shards} shards"
            print(f"kill {killed:3d} after {delay_s:5.2f} s: {shards}")
        else:
            print(f"done after {killed} kills; starting over in a new folder")
            folders.append(out.with_name(f"killed-{len(folders) + 1}"))
    job.run(folders[-1], *job.on_this_machine)
    return folders


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """SIGKILL to a job and all its workers; return when none of them is left."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    with suppress(ProcessLookupError):
        while True:
            os.killpg(process.pid, 0)
            time.sleep(0.01)


def run_ranges(job: Job, out: Path) -> None:
    """The job as ranges of shards, all at once."""
    edges = [math.ceil(job.num_shards * part / RANGES) for part in range(RANGES + 1)]
    ranges = [f"{a}-{b - 1}" for a, b in pairwise(edges) if a < b]
    for process in [job.start(out, "--shards", text) for text in ranges]:
        finish(process)
    job.run(out)  # completes the dataset should all have ended at the same instant; else nothing to do


def count_shards(folder: Path) -> int:
    """Finished tars."""
    return len(list(folder.glob("*/*.tar")))


def differences(whole: Path, other: Path) -> list[str]:
    """Files that are not the same in both folders."""
    contents = [
        {str(p.relative_to(folder)): sha256_of(p) for p in folder.rglob("*") if p.is_file()}
        for folder in (whole, other)
    ]
    return sorted(
        name for name in contents[0] | contents[1] if contents[0].get(name) != contents[1].get(name)
    )


def report(name: str, whole: Path, other: Path) -> bool:
    """Print whether two datasets are the same bytes; whether they are."""
    wrong = differences(whole, other)
    for file in wrong:
        print(f"{name}: {file} differs")
    print(f"{name}: {'DIFFERENT' if wrong else 'identical'}")
    return not wrong


def parse_arguments() -> argparse.Namespace:
    """Flags of the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--samples-per-shard", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the moments of killing")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS), help="what is compared")
    parser.add_argument("--preset", action="append", default=[])
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    return parser.parse_args()


def make_job(options: argparse.Namespace) -> Job:
    """The job that the flags describe."""
    settings = [f"shards.samples_per_shard={options.samples_per_shard}", *options.set]
    arguments = ["--frames", str(options.frames)]
    arguments += [word for name in options.preset for word in ("--preset", name)]
    arguments += [word for text in settings for word in ("--set", text)]
    config = load_config(
        DatasetConfig,
        "langwm_data",
        presets=options.preset,
        assignments=settings,
        overrides={"frames": options.frames},
    )
    return Job(arguments=tuple(arguments), workers=options.workers, num_shards=len(plan_shards(config)))


def main() -> None:
    """Run the job in every way and compare."""
    options = parse_arguments()
    options.out.mkdir(parents=True, exist_ok=False)
    job, whole = make_job(options), options.out / "whole"
    undisturbed_s = job.run(whole, *job.on_this_machine)
    print(f"undisturbed: {options.frames} frames in {job.num_shards} shards, {undisturbed_s:.1f} s")
    verdicts = []
    if "killed" in options.ways:
        rng = np.random.default_rng(options.seed)
        folders = kill_and_restart(job, options.out / "killed", options.kills, undisturbed_s, rng)
        name = f"killed {options.kills} times in {len(folders)} job{'s' * (len(folders) > 1)}"
        verdicts += [report(name, whole, folder) for folder in folders]
    if "ranges" in options.ways:
        run_ranges(job, options.out / "ranges")
        verdicts.append(report(f"{RANGES} ranges at once", whole, options.out / "ranges"))
    if "ray" in options.ways and importlib.util.find_spec("ray") is None:
        print("ray: not installed, not tried")
    elif "ray" in options.ways:
        job.run(options.out / "ray", "--engine", "ray")
        verdicts.append(report("ray", whole, options.out / "ray"))
    print(verdict := verify_dataset(whole).as_text())
    is_good = all(verdicts) and verdict.startswith("sound")
    print("one dataset, byte for byte" if is_good else "NOT one dataset")
    raise SystemExit(0 if is_good else 1)


if __name__ == "__main__":
    main()
