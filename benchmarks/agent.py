"""How fast stage three learns: one whole update part by part, and its memory.

Two updates are taken in turn, round by round, beside a product of matrices, which says what the machine
gives:

- ``paper``: everything that one update of the preset does: a batch from the replay buffer, the autoencoder
  on 800 frames, their features, world model, actor and critic. The embedded text encoder reads captions.
- ``vector``: world model and behaviour at the paper's sizes on a vector of 256 numbers in place of tokens, as
  general world-model libraries are measured.

Seconds are of the wall and of the CPU; on a busy machine the latter say more. FLOPs are counted by PyTorch.

    python benchmarks/agent.py --rounds 5 --json speed.json --markdown speed.md
    python benchmarks/agent.py --only vector --threads 1 --env
"""

# ruff: noqa: E402
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])  # beside this file, ``agent`` would mean this file

import argparse
import contextlib
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np
import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from agent.config import AgentConfig, ReplayConfig
from agent.envs.pointnav import PointNavEnv
from agent.models.nets import make_mlp
from agent.models.observation import ObservationModel
from agent.replay import Replay, ReplayEpisode
from agent.systems.dreamer import Perception, make_dreamer
from agent.systems.learner import DreamerLearner
from agent.systems.registry import find_system, load_agent_config
from agent.systems.system import Learner, Spaces
from benchmarks.stages import stage_clock
from pretrain.config import Precision
from pretrain.frames import FrameObject
from pretrain.precision import has_bf16

STAGES = {
    "replay: 16 x 50 steps read": ("agent.replay.buffer:Replay.sample",),
    "MAE: frames augmented, hidden, told of": ("agent.systems.finetune:make_mae_batch",),
    "MAE: update": ("agent.systems.finetune:mae_update",),
    "features": ("agent.systems.langwm:MAEPerception.encode",),
    "world model": ("agent.systems.learner:DreamerLearner._update_world_model",),
    "behaviour": ("agent.systems.learner:DreamerLearner._update_behavior",),
}
TASK_DIM = 4
VECTOR = 256
"""Numbers in place of tokens."""


class VectorModel(ObservationModel):
    """A vector in, a vector told again, each through a perceptron of the paper's size."""

    def __init__(self, config: AgentConfig) -> None:
        super().__init__()
        head, model = config.world_model.head, config.world_model
        self.embed_dim = head.units
        self.encoder = make_mlp(VECTOR + TASK_DIM, head.units, head.layers)
        self.decoder = make_mlp(model.rssm.feat_dim, head.units, head.layers, VECTOR)

    def embed(self, visual: Tensor, task: Tensor) -> Tensor:
        return self.encoder(torch.cat([visual, task], -1))

    def losses(self, target: Tensor, embed: Tensor, feat: Tensor) -> dict[str, Tensor]:
        return {"token": (self.decoder(feat) - target).square().sum(-1).mean()}


class NoisePerception(Perception):
    """The same random vectors whatever is seen."""

    def __init__(self, config: AgentConfig) -> None:
        super().__init__()
        self.vectors = torch.randn(config.batch_size * config.batch_length, VECTOR, device=config.device)

    def encode(self, obs: Mapping[str, Tensor]) -> Tensor:
        return self.vectors


@dataclass
class Figures:
    """What was measured of the parts of one update."""

    wall_s: dict[str, list[float]] = field(default_factory=dict)
    cpu_s: dict[str, list[float]] = field(default_factory=dict)
    gflop: dict[str, float] = field(default_factory=dict)
    peak_mib: int = 0
    """Resident memory of the process while it took an update."""

    def add(self, seconds: Mapping[str, np.ndarray]) -> None:
        """One more round."""
        whole = sum(seconds.values(), np.zeros(2))
        for name, (wall, cpu) in {**seconds, "whole update": whole}.items():
            self.wall_s.setdefault(name, []).append(float(wall))
            self.cpu_s.setdefault(name, []).append(float(cpu))

    def rows(self) -> list[dict]:
        """A row per part: medians and extremes."""
        return [
            {
                "part": name,
                "wall_s": statistics.median(wall),
                "wall_s_low": min(wall),
                "wall_s_high": max(wall),
                "cpu_s": statistics.median(self.cpu_s[name]),
                "gflop": self.gflop.get(name, 0.0),
            }
            for name, wall in self.wall_s.items()
        ]


def noise_episode(rng: np.random.Generator, config: AgentConfig, length: int) -> ReplayEpisode:
    """Random frames with three objects each: speed does not depend on what they show."""
    camera = config.env.camera
    objects = [
        FrameObject(category=name, bbox_xyxy=(x, 20.0, x + 30, 90.0), center_x=x + 15, distance_m=2.0)
        for name, x in (("chair", 5.0), ("sofa", 50.0), ("desk", 100.0))
    ]
    return ReplayEpisode(
        rgb=rng.integers(0, 256, (length, camera.height, camera.width, 3), dtype=np.uint8),
        depth_mm=rng.integers(500, 9000, (length, camera.height, camera.width), dtype=np.uint16),
        task=rng.normal(size=(length, TASK_DIM)).astype(np.float32),
        action=rng.uniform(-1, 1, (length, 2)).astype(np.float32),
        reward=rng.normal(size=length).astype(np.float32),
        objects=[objects] * length,
        is_terminal=False,
    )


def fill_replay(folder: Path, config: AgentConfig) -> Replay:
    """A buffer of a few episodes."""
    replay = Replay(ReplayConfig(), folder)
    rng = np.random.default_rng(0)
    for _ in range(8):
        replay.add(noise_episode(rng, config, 120))
    return replay


def make_learners(config: AgentConfig, only: str | None) -> dict[str, Learner]:
    """The contestants."""
    camera = config.env.camera
    spaces = Spaces(height=camera.height, width=camera.width, task_dim=TASK_DIM, action_dim=2)
    learners: dict[str, Learner] = {}
    if only in (None, "paper"):
        system = find_system("langwm")
        learners["paper"] = system.make_learner(system.create(config, spaces), config)
    if only in (None, "vector"):
        model = make_dreamer(NoisePerception(config), VectorModel(config), config, spaces).to(config.device)
        learners["vector"] = DreamerLearner(model, config)
    return learners


def read_clocks(device: str) -> np.ndarray:
    """Seconds of the wall and of the CPU, once everything asked for is done."""
    if device != "cpu":
        torch.accelerator.synchronize()
    return np.array([time.perf_counter(), time.process_time()])


def count_flops(learner: Learner, replay: Replay) -> dict[str, float]:
    """GFLOP of each part of an update."""
    with (
        FlopCounterMode(display=False) as counter,
        stage_clock(STAGES, lambda: counter.get_total_flops() / 1e9) as clock,
    ):
        learner.update(replay, 0)
    return {**clock.seconds, "whole update": sum(clock.seconds.values())}


def peak_mib(work: Callable[[], object]) -> int:
    """Most resident memory while ``work`` runs; Linux only."""
    Path("/proc/self/clear_refs").write_text("5")
    work()
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) // 1024


def matmul_gflops(device: str, dtype: torch.dtype) -> float:
    """GFLOP per second of the CPU's clock, or of the wall's where the device is another."""
    a, b = (torch.randn(1024, 1024, device=device).to(dtype) for _ in range(2))
    rates = []
    for _ in range(5):
        begin = read_clocks(device)
        for _ in range(4):
            a @ b
        wall, cpu = read_clocks(device) - begin
        rates.append(4 * 2 * 1024**3 / 1e9 / (cpu if device == "cpu" else wall))
    return max(rates)


def env_steps_per_s(config: AgentConfig, steps: int) -> dict[str, float]:
    """Environment steps with labels, without what beginning an episode takes."""
    rng = np.random.default_rng(0)
    taken = np.zeros(2)
    with contextlib.closing(PointNavEnv(replace(config.env, with_labels=True))) as env:
        env.reset(seed=0)
        for _ in range(steps):
            begin = read_clocks("cpu")
            _, _, terminated, truncated, _ = env.step(rng.uniform(-1, 1, 2).astype(np.float32))
            taken += read_clocks("cpu") - begin
            if terminated or truncated:
                env.reset()
    wall, cpu = taken
    return {"steps_per_wall_s": steps / wall, "steps_per_cpu_s": steps / cpu}


def measure(learners: Mapping[str, Learner], replay: Replay, device: str, rounds: int) -> dict[str, Figures]:
    """All contestants in turn; a first round, which warms up, counts FLOPs."""
    figures = {name: Figures() for name in learners}
    for name, learner in learners.items():
        figures[name].gflop = count_flops(learner, replay)
    for number in range(1, rounds + 1):
        for name, learner in learners.items():
            with stage_clock(STAGES, lambda: read_clocks(device)) as clock:
                figures[name].peak_mib = peak_mib(lambda: learner.update(replay, number))  # noqa: B023
            figures[name].add(clock.seconds)
    return figures


def as_markdown(found: Mapping) -> str:
    """The figures as tables."""
    lines = [f"{found['machine']}", ""]
    for name, held in found["updates"].items():
        lines += [
            f"**{name}**: peak resident memory {held['peak_mib']} MiB",
            "",
            "| part | wall s, median [low, high] | CPU s | GFLOP | GFLOP per CPU s |",
            "|---|---|---|---|---|",
        ]
        for row in held["rows"]:
            rate = row["gflop"] / row["cpu_s"] if row["cpu_s"] else 0.0
            spread = f"{row['wall_s']:.2f} [{row['wall_s_low']:.2f}, {row['wall_s_high']:.2f}]"
            lines.append(
                f"| {row['part']} | {spread} | {row['cpu_s']:.2f} | {row['gflop']:.0f} | {rate:.0f} |"
            )
        lines.append("")
    rates = ", ".join(f"{name} {rate:.0f}" for name, rate in found["matmul_gflops"].items())
    lines.append(f"Product of two 1024 x 1024 matrices, GFLOP per CPU s: {rates}.")
    if "env" in found:
        lines.append(f"Environment: {found['env']['steps_per_cpu_s']:.0f} steps per CPU s.")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", choices=["paper", "vector"])
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--precision", default="auto", choices=get_args(Precision))
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--env", action="store_true", help="also the environment, whose floor is made first")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    text = {"model": "minilm", "precision": args.precision}
    finetune = {"text": text, "optimizer": {"precision": args.precision}}
    overrides = {"precision": args.precision, "device": args.device, "finetune": finetune}
    config = load_agent_config("langwm", presets=[args.preset], overrides=overrides)
    with tempfile.TemporaryDirectory() as folder:
        replay = fill_replay(Path(folder), config)
        figures = measure(make_learners(config, args.only), replay, args.device, args.rounds)
    kinds = {"fp32": torch.float32} | ({"bf16": torch.bfloat16} if has_bf16(args.device) else {})
    found = {
        "machine": f"torch {torch.__version__}, {args.device}, {args.threads} threads, {args.precision},"
        f" {args.rounds} rounds",
        "matmul_gflops": {name: matmul_gflops(args.device, kind) for name, kind in kinds.items()},
        "updates": {n: {"rows": f.rows(), "peak_mib": f.peak_mib} for n, f in figures.items()},
    }
    if args.env:
        found["env"] = env_steps_per_s(config, 100)
    print(as_markdown(found))
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")
    if args.markdown:
        args.markdown.write_text(as_markdown(found))


if __name__ == "__main__":
    main()
