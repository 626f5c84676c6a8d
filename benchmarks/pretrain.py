"""How fast stage two trains: images a second beside transformers' ViTMAE, data, and the caption cache.

All figures of one run are measured in turn, round by round, so that a machine that is busy for a while
slows all of them. FLOPs are counted by PyTorch (forward and backward), not guessed.

    python benchmarks/pretrain.py --rounds 5 --batch 128
    python benchmarks/pretrain.py --data runs/data     # also: the share of time that training waits for data
"""

# ruff: noqa: E402
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])  # beside this file, ``pretrain`` would mean this file

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from langwm_data.config_io import load_config
from pretrain import LanguageGroundedMAE, pretrain_mae
from pretrain.batch import MAEBatch, TextTokens
from pretrain.config import MAEConfig, PretrainConfig, TextConfig
from pretrain.language import FrozenText
from pretrain.metrics import read_metrics
from pretrain.optim import Optimizer
from pretrain.update import mae_update

BERT_WIDTH = 768
CAPTION = "The {} is approximately {} meters, to the {}."


def noise_batch(config: MAEConfig, text: TextConfig, size: int) -> MAEBatch:
    """Random images and language tokens of the right shapes: speed does not depend on what they show."""
    shape = (size, config.height, config.width)
    length = text.num_language_tokens
    is_hidden = torch.zeros(shape, dtype=torch.bool)
    is_hidden[:, 30:90, 40:100] = True
    return MAEBatch(
        rgb=torch.randint(0, 256, (*shape, 3), dtype=torch.uint8),
        is_hidden=is_hidden,
        depth=10 * torch.rand(shape),
        text=TextTokens(embed=torch.randn(size, length, BERT_WIDTH), attend=torch.ones(size, length).bool()),
        captions=("",) * size,
        is_truncated=torch.zeros(size, dtype=torch.bool),
        reward=torch.zeros(size),
        has_reward=torch.zeros(size, dtype=torch.bool),
    )


def our_step(preset: str, size: int, device: str, **changes) -> Callable[[], object]:
    """One training step of a preset, batch and weights in place."""
    config = load_config(PretrainConfig, "pretrain", presets=[preset], assignments=[])
    optimizer_config = replace(config.optimizer, precision="bf16", **changes)
    batch = noise_batch(config.mae, config.text, size).to(device)
    null = TextTokens(embed=batch.text.embed[:1].cpu(), attend=batch.text.attend[:1].cpu())
    mae = LanguageGroundedMAE(config.mae, config.text, null).to(device)
    optimizer = Optimizer(mae, optimizer_config, 1000)
    if optimizer_config.is_compiled:
        mae.compile()
    return lambda: mae_update(mae, optimizer, batch, seed=0, step=1)


def peer_step(size: int, device: str) -> Callable[[], object]:
    """transformers' ViTMAE of equal depth and width, bf16; it reads square images only: 128 x 128."""
    from transformers import ViTMAEConfig, ViTMAEForPreTraining

    config = ViTMAEConfig(
        image_size=128,
        patch_size=16,
        hidden_size=256,
        num_hidden_layers=4,
        num_attention_heads=4,
        intermediate_size=1024,
        decoder_hidden_size=256,
        decoder_num_hidden_layers=3,
        decoder_num_attention_heads=4,
        decoder_intermediate_size=1024,
        mask_ratio=0.75,
    )
    model = ViTMAEForPreTraining(config).to(device).train()
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-4, fused=True)
    pixels = torch.randn(size, 3, 128, 128, device=device)

    def step() -> None:
        optimizer.zero_grad(set_to_none=True)
        with torch.autocast(device.partition(":")[0], torch.bfloat16):
            loss = model(pixels).loss
        loss.backward()
        optimizer.step()

    return step


def counted_gflop(step: Callable[[], object]) -> float:
    """Of one call."""
    with FlopCounterMode(display=False) as counter:
        step()
    return counter.get_total_flops() / 1e9


def seconds(step: Callable[[], object], device: str, calls: int) -> float:
    """Of one call, the mean of some."""
    start = time.perf_counter()
    for _ in range(calls):
        step()
    if device != "cpu":
        torch.accelerator.synchronize()
    return (time.perf_counter() - start) / calls


def compare(size: int, rounds: int, device: str, calls: int) -> list[dict]:
    """Images a second of all contestants, in turn."""
    steps = {
        "ours, preset paper": our_step("paper", size, device),
        "ours, preset homes": our_step("homes", size, device),
        "transformers ViTMAE": peer_step(size, device),
    }
    if device != "cpu":
        steps["ours, preset paper, compiled"] = our_step("paper", size, device, is_compiled=True)
    flop = {name: counted_gflop(step) / size for name, step in steps.items() if "compiled" not in name}
    times: dict[str, list[float]] = {name: [] for name in steps}
    for number in range(rounds + 1):
        for name, step in steps.items():
            taken = seconds(step, device, calls)
            if number:  # the first round warms up
                times[name].append(taken)
    rows = []
    for name, taken in times.items():
        rates = sorted(size / t for t in taken)
        middle = statistics.median(rates)
        gflop = flop.get(name, flop["ours, preset paper"])
        rows.append(
            {"name": name, "images_per_s": middle, "low": rates[0], "high": rates[-1], "gflop": gflop}
        )
        print(
            f"{name:32} {middle:8.0f} images/s [{rates[0]:.0f}, {rates[-1]:.0f}]"
            f"  {gflop:.2f} GFLOP/image  {middle * gflop:.0f} GFLOP/s"
        )
    return rows


def time_captions(rounds: int) -> dict:
    """Captions a second with an empty and with a full cache."""
    rng = np.random.default_rng(0)
    things, sides = ("chair", "sofa", "bed", "desk", "lamp"), ("left", "right", "front")
    captions = [CAPTION.format(t, d, s) for t in things for d in range(2, 10) for s in sides]
    drawn = rng.choice(captions, 800).tolist()
    cold, warm = [], []
    for _ in range(rounds):
        text = FrozenText(TextConfig(model="minilm", precision="bf16"))
        for times in (cold, warm):
            start = time.perf_counter()
            text.embed(drawn)
            times.append(len(drawn) / (time.perf_counter() - start))
    row = {"cold": statistics.median(cold), "warm": statistics.median(warm), "distinct": len(set(drawn))}
    print(
        f"captions: {row['cold']:.0f}/s with an empty cache ({row['distinct']} different ones of 800),"
        f" {row['warm']:.0f}/s with a full one"
    )
    return row


def time_training(data: Path, steps: int) -> dict:
    """A short real run: images a second and how much of the time it waits for data, after the start."""
    config = load_config(
        PretrainConfig,
        "pretrain",
        presets=["homes"],
        assignments=[f"steps={steps}", "log_every=1", f"valid_every={steps}", "valid_frames=1"],
    )
    with tempfile.TemporaryDirectory() as folder:
        rows = read_metrics(pretrain_mae(config, data, Path(folder) / "run"))[steps // 3 : -1]
    row = {
        "images_per_s": statistics.median(r["perf/images_per_s"] for r in rows),
        "data_wait_share": statistics.mean(r["perf/data_wait_share"] for r in rows),
    }
    print(
        f"homes on {data}: {row['images_per_s']:.0f} images/s, waits {row['data_wait_share']:.1%} of the time"
    )
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--calls", type=int, default=2, help="steps of each contestant in a round")
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--data", type=Path, help="a dataset of 128x160 frames, for the real run")
    parser.add_argument("--steps", type=int, default=60, help="of the real run")
    parser.add_argument("--json", type=Path, help="write the figures there")
    args = parser.parse_args()
    threads = torch.get_num_threads()
    print(f"torch {torch.__version__}, {threads} threads, {args.device}, batch {args.batch}, bf16")
    found: dict = {"training": compare(args.batch, args.rounds, args.device, args.calls)}
    found["captions"] = time_captions(args.rounds)
    if args.data:
        found["run"] = time_training(args.data, args.steps)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
