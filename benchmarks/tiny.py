"""Speed of each part at the `tiny` preset, one line a figure: median and range over repeats.

Run on an idle machine: python benchmarks/tiny.py
"""

import resource
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch

from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig, RobotConfig, ScenesConfig
from langwm_data.config_io import load_config
from langwm_data.labels.instances import label_frame
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
from pretrain.config import PretrainConfig
from pretrain.frames import FrameBatch, FrameObject
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.optim import Optimizer
from pretrain.update import batch_rngs, mae_update, make_mae_batch

SCENE = "Alder_0"
REPEATS = 5


def report(name: str, unit: str, per_repeat: int, work: Callable[[], object]) -> None:
    work()
    rates = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        rates.append(per_repeat / (time.perf_counter() - start))
    low, middle, high = min(rates), statistics.median(rates), max(rates)
    print(f"{name:<34}{middle:9.1f} {unit:<12} ({low:.1f} to {high:.1f}, {REPEATS} repeats)")


def bench_rendering(config: DatasetConfig) -> list:
    scene = open_scenes(ScenesConfig()).load(SCENE)
    free, rng = FreeSpace.from_scene(scene, robot=RobotConfig()), np.random.default_rng(0)
    cameras = [Camera.on_robot(config.camera, tuple(free.sample(rng)), rng.uniform(-3, 3)) for _ in range(50)]
    renderer = make_renderer(config.render)
    renderer.load(scene)
    frames = [renderer.render(camera) for camera in cameras]
    report("render 128x160, 1 core", "frames/s", 50, lambda: [renderer.render(c) for c in cameras])
    table = scene.instances()

    def label() -> list:
        return [label_frame(f.instance, f.depth, table, config.labels, rng) for f in frames]

    report("label", "frames/s", 50, label)
    return [(frame, labels) for frame, labels in zip(frames, label(), strict=True)]


def bench_pretraining(config: PretrainConfig, seen: list) -> None:
    text = FrozenText(config.text, torch.device("cpu"))
    mae = LanguageGroundedMAE(config.mae, config.text, text.null_text)
    optimizer = Optimizer(mae, config.optimizer)
    chosen = [seen[i % len(seen)] for i in range(config.batch_size)]
    objects = [
        [
            FrameObject(
                category=o.category,
                bbox_xyxy=o.bbox_xyxy,
                center_x=o.center_px[0],
                distance_m=o.distance_m,
            )
            for o in labels
            if o.captions
        ]
        for _, labels in chosen
    ]
    frames = FrameBatch(
        rgb=np.stack([f.rgb for f, _ in chosen]),
        depth=np.stack([f.depth for f, _ in chosen]),
        objects=objects,
        reward=np.zeros(len(chosen), np.float32),
        has_reward=np.zeros(len(chosen), np.bool_),
    )

    def make(step: int):
        return make_mae_batch(
            batch_rngs(0, step, range(len(frames))), frames, text, config.objects, config.augment
        )

    for step in range(200):
        make(step)
    report("batches, captions cached", "images/s", config.batch_size, lambda: make(0))
    batch = make(0)
    report(
        "pretraining step",
        "images/s",
        config.batch_size,
        lambda: mae_update(mae, optimizer, batch, seed=0, step=0),
    )
    mae.eval()
    report("encode, one frame", "frames/s", 20, lambda: [mae.encode(batch.rgb[:1]) for _ in range(20)])


def bench_environment() -> None:
    scene, action = open_scenes(ScenesConfig()).load(SCENE), np.array([0.2, 0.3], np.float32)
    for is_blind in (False, True):
        env = PointNavEnv(EnvConfig(is_blind=is_blind, max_steps=100_000), scenes=[scene])
        env.reset(seed=0)
        name = "environment, blind" if is_blind else "environment 128x160"
        report(name, "steps/s", 50, lambda env=env: [env.step(action) for _ in range(50)])
        env.close()


def main() -> None:
    seen = bench_rendering(load_config(DatasetConfig, "langwm_data", presets=["tiny"]))
    bench_pretraining(load_config(PretrainConfig, "pretrain", presets=["tiny"]), seen)
    bench_environment()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{'peak memory':<34}{peak:9.0f} MiB")


if __name__ == "__main__":
    main()
