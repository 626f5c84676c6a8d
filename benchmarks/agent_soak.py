"""Does the memory of a long training run stay flat? Many short episodes with a small net, for a stated time.

The frames are black and episodes end after a few steps, so that resets of scenes, physics and lights, files
of the replay buffer that come and go, checkpoints and metrics happen as often as they would in many hours.

    python -m benchmarks.agent_soak --out DIR [--seconds 300] [--set a.b=v]
"""

import argparse
import gc
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import torch

from agent.systems.registry import load_agent_config
from agent.train import train_agent
from langwm_data.config_io import merge, parse_assignment

SETTINGS = {
    "steps": 10**7,
    "prefill_steps": 200,
    "update_every": 20,
    "checkpoint_every": 1000,
    "log_every": 5,
    "env": {"is_blind": True, "max_steps": 12, "camera": {"height": 16, "width": 16}},
    "replay": {"capacity_steps": 2000},
    "world_model": {"pixels": {"channels": 2}},
}
SAMPLES = 20


def read_state() -> tuple[float, int, int]:
    """Resident memory in MB, open files, threads."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return (
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(list(Path("/proc/self/fd").iterdir())),
        threading.active_count(),
    )


def main() -> None:
    """Train, note the memory, stop when the time is over."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--system", default="dreamerv2")
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    overrides = SETTINGS
    for text in asked.set:
        overrides = merge(overrides, parse_assignment(text))
    config = load_agent_config(asked.system, presets=["debug"], overrides=overrides)
    begin, rows = time.monotonic(), []

    def note(done: int, total: int) -> None:
        elapsed = time.monotonic() - begin
        if elapsed < len(rows) * asked.seconds / SAMPLES:
            return
        rows.append((done, *read_state(), len(gc.get_objects())))
        step, memory, files, threads, objects = rows[-1]
        print(f"| {elapsed:.0f} | {step:,} | {memory:.1f} | {files} | {threads} | {objects:,} |", flush=True)
        if elapsed >= asked.seconds:
            os.kill(os.getpid(), signal.SIGTERM)

    print("| s | steps | resident MB | open files | threads | objects |\n|---|---|---|---|---|---|")
    try:
        train_agent(config, asked.out, progress=note)
    except KeyboardInterrupt:
        print(f"stopped; {time.process_time():.0f} s of CPU")
    early, late = np.array_split(np.array(rows), 2)
    slope = np.polyfit(late[:, 0], late[:, 1], 1)[0]
    print(f"second half: {1e5 * slope:+.2f} MB in 100,000 steps, by a straight line")
    print(f"at most {early[:, 1].max():.1f} MB in the first half, {late[:, 1].max():.1f} MB in the second")


if __name__ == "__main__":
    main()
