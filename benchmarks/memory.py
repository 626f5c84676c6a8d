"""Does a longer job need more memory? Peaks of a short and of a long one, all their processes together.

Every tenth of a second the proportional set sizes (PSS: pages that several processes share are divided
among them) of the job and of all its descendants are added up from ``/proc/*/smaps_rollup``.

python benchmarks/memory.py [--frames 2000 20000] [--workers 2] [--preset NAME] [--set a.b=v]
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

EVERY_S = 0.1
MOST = 1.10
"""Allowed ratio of the longer job's peak to that of the shorter."""


def descendants(pid: int) -> list[int]:
    """A process and all that it has started, directly or not."""
    children: dict[int, list[int]] = defaultdict(list)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text()
        except OSError:  # it has just ended
            continue
        children[int(stat.rpartition(")")[2].split()[1])].append(int(folder.name))
    found = [pid]
    for each in found:
        found += children[each]
    return found


def pss_bytes(pid: int) -> int:
    """Proportional set size of one process; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:")), 0)


def watch(process: subprocess.Popen[bytes]) -> list[int]:
    """Bytes of a job and its descendants, every ``EVERY_S`` until it ends."""
    sizes = []
    while process.poll() is None:
        sizes.append(sum(map(pss_bytes, descendants(process.pid))))
        time.sleep(EVERY_S)
    return sizes


def run_job(frames: int, workers: int, more: list[str]) -> list[int]:
    """Render a dataset that is thrown away; its sizes over time.

    Raises:
        SystemExit: If it fails.
    """
    root = Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory(prefix="langwm-memory-") as folder:
        command = [sys.executable, str(root / "cli.py"), "render-dataset", "--out", f"{folder}/data"]
        command += ["--frames", str(frames), "--workers", str(workers), *more]
        environment = os.environ | {"PYTHONPATH": str(root), "LANGWM_LOG": "WARNING"}
        with subprocess.Popen(command, cwd=root, env=environment, stdout=subprocess.DEVNULL) as process:
            sizes = watch(process)
        if process.returncode:
            raise SystemExit(f"the job of {frames} frames failed with exit code {process.returncode}")
    return sizes


def main() -> None:
    """Run the two jobs and compare their peaks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--frames", type=int, nargs=2, default=[2000, 20000])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--preset", action="append", default=[])
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    options = parser.parse_args()
    more = [word for name in options.preset for word in ("--preset", name)]
    more += [word for text in options.set for word in ("--set", text)]
    peaks = []
    for frames in options.frames:
        sizes = run_job(frames, options.workers, more)
        peaks.append(max(sizes))
        print(
            f"{frames:6d} frames, {options.workers} workers: peak {max(sizes) / 2**20:.0f} MiB of PSS,"
            f" median {statistics.median(sizes) / 2**20:.0f} MiB, {len(sizes)} looks"
        )
    ratio = peaks[1] / peaks[0]
    print(f"ratio of peaks: {ratio:.3f}; allowed: {MOST}")
    raise SystemExit(0 if ratio <= MOST else 1)


if __name__ == "__main__":
    main()
