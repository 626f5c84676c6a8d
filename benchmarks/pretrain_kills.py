"""A pretraining run killed again and again: does it learn what an undisturbed one learns?

First it runs undisturbed. Then, in another folder, its process is killed with SIGKILL once its log has
reached a random step, and started again, and in the end left to finish. Every logged number but those of
speed, and the weights, are compared.

python -m benchmarks.pretrain_kills --out DIR [--data DATA] [--kills 20] [--steps 400] [--preset debug]
    [--seed 0] [--set a.b=v]
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

import pretrain.train  # noqa: F401  (imported before the first fork)
from benchmarks.forks import Command, learned
from langwm_data.shards.writer import sha256_of
from pretrain.language import MINILM, load_bert

_LONGEST_DELAY_S = 0.1
"""After the step has been logged: kills also fall between steps and into the writing of checkpoints."""
_SECONDS = "perf/"
"""How names of metrics begin that depend on the machine."""
WEIGHTS = "model/model.safetensors"


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
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=False)
    data = options.data or options.out / "data"
    if options.data is None:
        Command(arguments=("render-dataset", "--preset", "debug")).finish(data)
    settings = ["log_every=1", *options.set]
    flags = ["--data", str(data.resolve()), "--preset", options.preset, "--steps", str(options.steps)]
    arguments = ("pretrain-mae", *flags, *(word for text in settings for word in ("--set", text)))
    run = Command(arguments=arguments)
    whole, killed = options.out.resolve() / "whole", options.out.resolve() / "killed"
    load_bert(MINILM)  # what it imports is then there in every fork
    start = time.perf_counter()
    run.finish(whole)
    print(f"undisturbed: {options.steps} steps, {time.perf_counter() - start:.1f} s", flush=True)
    rng = np.random.default_rng(options.seed)
    for number, step in enumerate(sorted(rng.integers(1, options.steps, options.kills).tolist()), start=1):
        last = run.kill_at(killed, step, float(rng.uniform(0, _LONGEST_DELAY_S)))
        print(f"kill {number:3d} at step {last}", flush=True)
    run.finish(killed)
    rows = learned(whole, except_for=_SECONDS)
    is_same = rows == learned(killed, except_for=_SECONDS) and len(rows) == options.steps
    has_same_weights = sha256_of(whole / WEIGHTS) == sha256_of(killed / WEIGHTS)
    print(f"{len(rows)} logged steps: {'equal' if is_same else 'DIFFERENT'}")
    print(f"weights: {'equal' if has_same_weights else 'DIFFERENT'}")
    raise SystemExit(0 if is_same and has_same_weights else 1)


if __name__ == "__main__":
    main()
