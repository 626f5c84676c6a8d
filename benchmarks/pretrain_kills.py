"""A pretraining run killed again and again: does it learn what an undisturbed one learns?

First it runs undisturbed. Then, in another folder, its process is killed with SIGKILL once its log has
reached a random step, and started again, and in the end left to finish. Every logged number but those of
speed, and the weights, are compared.

python -m benchmarks.pretrain_kills --out DIR [--data DATA] [--kills 20] [--steps 400] [--preset debug]
    [--seed 0] [--set a.b=v]
"""

import argparse
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.kills import finish, kill_group
from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import load_config
from langwm_data.shards.writer import sha256_of
from pretrain.metrics import read_metrics

_LONGEST_DELAY_S = 0.1
"""After the step has been logged: kills also fall between steps and into the writing of checkpoints."""
_POLL_S = 0.01
WEIGHTS = "model/model.safetensors"


@dataclass(frozen=True, kw_only=True)
class Run:
    """One call of ``langwm pretrain-mae``, but for where it writes."""

    arguments: tuple[str, ...]

    def start(self, out: Path) -> subprocess.Popen[bytes]:
        """Begin it, or go on with it, in a process group of its own."""
        root = Path(__file__).resolve().parent.parent
        return subprocess.Popen(
            [sys.executable, str(root / "cli.py"), "pretrain-mae", "--out", str(out), *self.arguments],
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root), "LANGWM_LOG": "WARNING"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )


def kill_at(run: Run, out: Path, step: int, delay_s: float) -> int:
    """Go on until ``step`` has been logged and a moment longer, then kill; the last step that was logged."""
    process = run.start(out)
    while last_step(out) < step and process.poll() is None:
        time.sleep(_POLL_S)
    time.sleep(delay_s)
    if process.poll():
        finish(process)
    kill_group(process)
    return last_step(out)


def last_step(out: Path) -> int:
    """Of the log; what a run that goes on takes back still counts until it does."""
    rows = read_metrics(out)
    return rows[-1]["step"] if rows else 0


def learned(out: Path) -> list[dict[str, float]]:
    """The log without what depends on the machine."""
    return [{k: v for k, v in row.items() if not k.startswith("perf/")} for row in read_metrics(out)]


def parse_arguments() -> argparse.Namespace:
    """Flags of the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    parser.add_argument("--data", type=Path, help="a dataset; without it, a small one is rendered")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--preset", default="debug")
    parser.add_argument("--seed", type=int, default=0, help="of the moments of killing")
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    return parser.parse_args()


def main() -> None:
    """Run both and compare."""
    options = parse_arguments()
    options.out.mkdir(parents=True, exist_ok=False)
    data = options.data or render_dataset(
        load_config(DatasetConfig, "langwm_data", presets=["debug"]), options.out / "data"
    )
    settings = ["log_every=1", *options.set]
    flags = ["--data", str(data.resolve()), "--preset", options.preset, "--steps", str(options.steps)]
    run = Run(arguments=(*flags, *(word for text in settings for word in ("--set", text))))
    whole, killed = options.out.resolve() / "whole", options.out.resolve() / "killed"
    start = time.perf_counter()
    finish(run.start(whole))
    print(f"undisturbed: {options.steps} steps, {time.perf_counter() - start:.1f} s")
    rng = np.random.default_rng(options.seed)
    for number, step in enumerate(sorted(rng.integers(1, options.steps, options.kills).tolist()), start=1):
        last = kill_at(run, killed, step, float(rng.uniform(0, _LONGEST_DELAY_S)))
        print(f"kill {number:3d} at step {last}", flush=True)
    finish(run.start(killed))
    rows = learned(whole)
    is_same = rows == learned(killed) and len(rows) == options.steps
    has_same_weights = sha256_of(whole / WEIGHTS) == sha256_of(killed / WEIGHTS)
    print(f"{len(rows)} logged steps: {'equal' if is_same else 'DIFFERENT'}")
    print(f"weights: {'equal' if has_same_weights else 'DIFFERENT'}")
    raise SystemExit(0 if is_same and has_same_weights else 1)


if __name__ == "__main__":
    main()
