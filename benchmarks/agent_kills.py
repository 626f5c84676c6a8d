"""A training run killed again and again: does it learn what an undisturbed one learns?

First ``langwm train-agent`` runs undisturbed. Then, in another folder, it is killed with SIGKILL once its log
has reached a random step and a random moment longer, and started again, and in the end left to finish. Every
logged number but those of speed, the weights, the best agent's weights and the episodes in the replay buffer
are compared. Each start is a fork of this process, so that PyTorch is imported once.

    python -m benchmarks.agent_kills --out DIR [--kills 20] [--seed 0] [-- train-agent's own flags]
"""

import argparse
import os
import signal
import time
from pathlib import Path

import numpy as np
import torch

import agent.train  # noqa: F401  (imported before the first fork)
import cli
from agent.best import BEST_FOLDER
from agent.systems.agent import WEIGHTS_FILE
from agent.train import REPLAY_FOLDER
from langwm_data.shards.writer import sha256_of
from pretrain.metrics import read_metrics
from pretrain.model_file import MODEL_FOLDER

_LONGEST_DELAY_S = 0.5
"""After the step has been logged: kills also fall between steps and into the writing of checkpoints."""
_POLL_S = 0.02
FLAGS = ("--preset", "debug", "--steps", "300", "--set", "log_every=1")


def start(out: Path, flags: list[str]) -> int:
    """Begin the run, or go on with it, in a process of its own; its id."""
    pid = os.fork()
    if pid:
        return pid
    os.setsid()
    with (out.parent / f"{out.name}.log").open("a") as log:
        for stream in (1, 2):
            os.dup2(log.fileno(), stream)
        os._exit(cli.run(["train-agent", "--out", str(out), *flags]))


def finish(pid: int) -> None:
    """Wait for the run to end by itself."""
    _, status = os.waitpid(pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"train-agent failed with {os.waitstatus_to_exitcode(status)}; see its log")


def kill_at(out: Path, flags: list[str], step: int, delay_s: float) -> int:
    """Go on until ``step`` has been logged and a moment longer, then kill; the last step that was logged."""
    pid = start(out, flags)
    while last_step(out) < step:
        if os.waitpid(pid, os.WNOHANG)[0]:
            raise SystemExit("train-agent ended before it could be killed; see its log")
        time.sleep(_POLL_S)
    time.sleep(delay_s)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return last_step(out)


def last_step(out: Path) -> int:
    """Of the log; what a run that goes on takes back still counts until it does."""
    rows = read_metrics(out)
    return rows[-1]["step"] if rows else 0


def learned(out: Path) -> list[dict[str, float]]:
    """The log without what depends on the machine."""
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(out)]


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
    flags = [*FLAGS, *asked.flags]
    whole, killed = asked.out.resolve() / "whole", asked.out.resolve() / "killed"
    begin = time.perf_counter()
    finish(start(whole, flags))
    steps = last_step(whole)
    print(f"undisturbed: {steps} steps, {time.perf_counter() - begin:.1f} s", flush=True)
    rng = np.random.default_rng(asked.seed)
    for number, step in enumerate(sorted(rng.integers(1, steps, asked.kills).tolist()), start=1):
        last = kill_at(killed, flags, step, float(rng.uniform(0, _LONGEST_DELAY_S)))
        print(f"kill {number:3d} at step {last}", flush=True)
    finish(start(killed, flags))
    same_log, same_files = learned(whole) == learned(killed), checksums(whole) == checksums(killed)
    print(f"{len(learned(whole))} lines of metrics: {'equal' if same_log else 'DIFFERENT'}")
    print(f"{len(checksums(whole))} files of weights and episodes: {'equal' if same_files else 'DIFFERENT'}")
    raise SystemExit(0 if same_log and same_files else 1)


if __name__ == "__main__":
    main()
