"""A training run killed again and again: does it learn what an undisturbed one learns?

First ``langwm train-agent`` runs undisturbed. Then, in another folder, it is killed with SIGKILL once its log
has reached a random step and a random moment longer, and started again, and in the end left to finish. Every
logged number but those of speed, the weights, the best agent's weights and the episodes in the replay buffer
are compared.

    python -m benchmarks.agent_kills --out DIR [--kills 20] [--seed 0] [-- train-agent's own flags]
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

import agent.train  # noqa: F401  (imported before the first fork)
from agent.best import BEST_FOLDER
from agent.systems.agent import WEIGHTS_FILE
from agent.train import REPLAY_FOLDER
from benchmarks.forks import Command, last_step, learned
from langwm_data.shards.writer import sha256_of
from pretrain.model_file import MODEL_FOLDER

_LONGEST_DELAY_S = 0.5
"""After the step has been logged: kills also fall between steps and into the writing of checkpoints."""
_SECONDS = "time/"
"""How names of metrics begin that depend on the machine."""
FLAGS = ("--preset", "debug", "--steps", "300", "--set", "log_every=1")


def checksums(out: Path) -> dict[str, str]:
    """Of the weights, last and best, and of every episode in the replay buffer."""
    paths = [
        out / MODEL_FOLDER / WEIGHTS_FILE,
        out / BEST_FOLDER / WEIGHTS_FILE,
        *sorted((out / REPLAY_FOLDER).glob("episode-*")),
    ]
    return {str(path.relative_to(out)): sha256_of(path) for path in paths if path.is_file()}


def main() -> None:
    """Run both and compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the moments of killing")
    parser.add_argument("flags", nargs="*", help="of train-agent, after --")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    asked.out.mkdir(parents=True, exist_ok=False)
    run = Command(arguments=("train-agent", *FLAGS, *asked.flags))
    whole, killed = asked.out.resolve() / "whole", asked.out.resolve() / "killed"
    begin = time.perf_counter()
    run.finish(whole)
    steps = last_step(whole)
    print(f"undisturbed: {steps} steps, {time.perf_counter() - begin:.1f} s", flush=True)
    rng = np.random.default_rng(asked.seed)
    for number, step in enumerate(sorted(rng.integers(1, steps, asked.kills).tolist()), start=1):
        last = run.kill_at(killed, step, float(rng.uniform(0, _LONGEST_DELAY_S)))
        print(f"kill {number:3d} at step {last}", flush=True)
    run.finish(killed)
    rows, files = learned(whole, except_for=_SECONDS), checksums(whole)
    same_log, same_files = rows == learned(killed, except_for=_SECONDS), files == checksums(killed)
    print(f"{len(rows)} lines of metrics: {'equal' if same_log else 'DIFFERENT'}")
    print(f"{len(files)} files of weights and episodes: {'equal' if same_files else 'DIFFERENT'}")
    raise SystemExit(0 if same_log and same_files else 1)


if __name__ == "__main__":
    main()
