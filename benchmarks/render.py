"""Labelled frames written to disk per second with two workers, beside bare loops of TinyRenderer.

Both draw the same views: those of a dataset that is rendered first, its floors, materials and cameras. In
turn, as many rounds as are asked for:

- `tiny`: PyBullet's getCameraImage and nothing else in two processes at once; loading is not timed;
- `dataset`: render_dataset with two workers into an empty folder, by the clock, all of it, and from 40 to
  90 % of its frames, when every worker holds every floor;
- `bare`: rendering and PNG encoding alone in two processes at once, as `tiny`.

Then the CPU time of one worker, stage by stage, and what each renderer draws on one core.

    python benchmarks/render.py [--furniture DIR] [--frames 4000] [--rounds 5] [--json FILE]
"""

import argparse
import dataclasses
import multiprocessing
import os
import shutil
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from stages import stage_clock

from langwm_data import ShardDataset, atomic, render_dataset
from langwm_data.config import DatasetConfig, ScenesConfig, ShardsConfig
from langwm_data.frames import RenderWorker
from langwm_data.plan import plan_shards
from langwm_data.png import encode_png
from langwm_data.scenes.assets import ASSETS_DIR, Assets
from langwm_data.shards.sample import to_millimetres
from langwm_data.shards.scenes import read_scene
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import Renderer, describe_renderer, make_renderer
from langwm_data.sim.render_tiny import TinyRenderer
from langwm_data.sim.render_tiny import _projection_matrix as projection_matrix
from langwm_data.sim.render_tiny import _view_matrix as view_matrix

PROCESSES = 2
EVERY = 8
"""Loops draw one in so many of the dataset's frames, of every block."""
STEADY = (0.4, 0.9)
TINY = "tiny, getCameraImage alone, frames/s"
IN_ALL, STEADILY = "dataset, frames/s, all of it", "dataset, frames/s, steady"
BARE = "rendering and PNG alone, frames/s"

Work = Callable[[Any, list[Camera]], list[Callable[[], object]]]
"""What is timed, a call for each view."""
Clock = Callable[[], float]
Block = tuple[str, list[str], list[Camera]]
"""Floor, materials, and where its views are taken."""


def read_blocks(data: Path, config: DatasetConfig) -> list[Block]:
    """The views that loops draw."""
    blocks: list[Block] = []
    frames = ShardDataset(data).frames.select(["scene", "materials", "camera_x", "camera_y", "yaw_rad"])
    for row in frames.to_pylist()[::EVERY]:
        if not blocks or blocks[-1][:2] != (row["scene"], row["materials"]):
            blocks.append((row["scene"], row["materials"], []))
        camera = Camera.on_robot(config.camera, (row["camera_x"], row["camera_y"]), row["yaw_rad"])
        blocks[-1][2].append(camera)
    return blocks


def drawn_blocks(data: Path, renderer: Renderer, blocks: list[Block]) -> Iterator[list[Camera]]:
    """The cameras of each block, while the renderer holds its floor and materials."""
    held, scene = None, None
    for name, materials, cameras in sorted(blocks, key=lambda block: block[0]):
        if name != held:
            scene = read_scene(data, name)
            renderer.load(scene)
            held = name
        renderer.set_palette(scene.read_palette(materials))
        for camera in cameras:
            renderer.render(camera)  # draws the textures
        yield cameras


def loop(data: Path, config: DatasetConfig, work: Work, clock: Clock, blocks: list[Block]) -> float:
    """Views drawn per second of ``clock``; loading floors and drawing textures is not timed."""
    renderer, seconds, count = make_renderer(config.render, Assets(data / ASSETS_DIR)), 0.0, 0
    for cameras in drawn_blocks(data, renderer, blocks):
        calls = work(renderer, cameras)
        start = clock()
        for call in calls:
            call()
        seconds += clock() - start
        count += len(calls)
    renderer.close()
    return count / seconds


def bare_tiny(renderer: TinyRenderer, cameras: list[Camera]) -> list[Callable[[], object]]:
    """PyBullet's own call, without making arrays of what it returns."""
    draw = partial(
        renderer._bullet.getCameraImage,
        renderer=renderer._bullet.ER_TINY_RENDERER,
        shadow=0,
        physicsClientId=renderer._client,
    )
    return [
        partial(
            draw,
            camera.width,
            camera.height,
            viewMatrix=view_matrix(camera),
            projectionMatrix=projection_matrix(camera),
        )
        for camera in cameras
    ]


def rendering(renderer: Renderer, cameras: list[Camera]) -> list[Callable[[], object]]:
    return [partial(renderer.render, camera) for camera in cameras]


def rendering_and_encoding(renderer: Renderer, cameras: list[Camera]) -> list[Callable[[], object]]:
    def draw(camera: Camera) -> None:
        frame = renderer.render(camera)
        for image in (frame.rgb, to_millimetres(frame.depth), frame.instance):
            encode_png(image)

    return [partial(draw, camera) for camera in cameras]


def in_processes(data: Path, config: DatasetConfig, work: Work, blocks: list[Block]) -> float:
    """Views a second of all processes together, by the clock."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(PROCESSES) as pool:
        job = partial(loop, data, config, work, time.perf_counter)
        return sum(pool.map(job, [blocks[i::PROCESSES] for i in range(PROCESSES)], chunksize=1))


def timed_dataset(config: DatasetConfig, out: Path) -> dict[str, float]:
    """Frames a second of ``render_dataset``: of all of it, and of its steady middle."""
    seen: list[tuple[float, int]] = []
    start = time.perf_counter()
    render_dataset(
        config, out, workers=PROCESSES, progress=lambda done, _: seen.append((time.perf_counter(), done))
    )
    total = time.perf_counter() - start
    (t0, n0), (t1, n1) = (next(s for s in seen if s[1] >= share * config.frames) for share in STEADY)
    steady = (n1 - n0) / (t1 - t0)
    return {
        IN_ALL: config.frames / total,
        STEADILY: steady,
        "dataset, seconds that are not frames": total - config.frames / steady,
    }


def stage_table(config: DatasetConfig, data: Path) -> dict[str, float]:
    """CPU milliseconds a frame of each stage of one worker that holds all floors and textures."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        for name in ("scenes", "assets"):
            if (data / name).is_dir():
                shutil.copytree(data / name, out / name)
        with RenderWorker(config, out) as worker:
            for is_counted in (False, True):
                with stage_clock() as clock:
                    for task in plan_shards(config):
                        worker(task, lambda _: None)
                if is_counted:
                    return {name: 1000 * s / config.frames for name, s in clock.seconds.items()}
    raise AssertionError("unreachable")


def measure(config: DatasetConfig, folder: Path, rounds: int) -> dict[str, Any]:
    """All figures of one kind of scenes: lists are of rounds."""
    data = folder / "data"
    figures: dict[str, Any] = {
        f"{key}, first time": value for key, value in timed_dataset(config, data).items()
    }
    blocks = read_blocks(data, config)
    tiny = dataclasses.replace(config, render=dataclasses.replace(config.render, backend="tiny"))
    lists: defaultdict[str, list[float]] = defaultdict(list)
    for _ in range(rounds):
        lists[TINY].append(in_processes(data, tiny, bare_tiny, blocks))
        with tempfile.TemporaryDirectory(dir=folder) as out:
            for key, value in timed_dataset(config, Path(out) / "again").items():
                lists[key].append(value)
        lists[BARE].append(in_processes(data, config, rendering_and_encoding, blocks))
    for name, key in (("all", IN_ALL), ("steady", STEADILY)):
        lists[f"{name} / tiny"] = [a / b for a, b in zip(lists[key], lists[TINY], strict=True)]
    lists["steady / rendering and PNG"] = [a / b for a, b in zip(lists[STEADILY], lists[BARE], strict=True)]
    figures |= lists
    for backend in ("gl", "embree", "tiny"):
        render = dataclasses.replace(config.render, backend=backend)
        one = dataclasses.replace(config, render=render)
        figures[f"{backend}, frames/s of one core's CPU time"] = loop(
            data, one, rendering, time.process_time, blocks[::4]
        )
    figures["stages"] = stage_table(config, data)
    return figures


def show(name: str, figures: dict[str, Any]) -> None:
    print(f"\n{name}")
    for key, value in figures.items():
        if key == "stages":
            print(f"  one worker, CPU ms a frame: {sum(value.values()):.2f}")
            for stage, ms in sorted(value.items(), key=lambda item: -item[1]):
                print(f"    {stage:<40}{ms:8.3f}")
        elif isinstance(value, list):
            print(f"  {key:<50}{statistics.median(value):8.2f}  ({min(value):.2f} to {max(value):.2f})")
        else:
            print(f"  {key:<50}{value:8.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--furniture", help="folder of Sweet Home 3D catalogues (.sh3f)")
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path, help="where to write all figures")
    asked = parser.parse_args()
    config = DatasetConfig(frames=asked.frames, shards=ShardsConfig(samples_per_shard=asked.frames // 16))
    cases = {"homes": config}
    if asked.furniture is None:
        print("homes with catalogue furniture are left out: they need --furniture DIR")
    else:
        scenes = ScenesConfig(furniture=asked.furniture)
        cases["homes with catalogue furniture"] = dataclasses.replace(config, scenes=scenes)
    print(f"{describe_renderer(config.render)}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # so that the first time is one
        for name, case in cases.items():
            figures[name] = measure(case, Path(folder) / name.replace(" ", "-"), asked.rounds)
            show(name, figures[name])
    if asked.json is not None:
        atomic.write_json(asked.json, figures)


if __name__ == "__main__":
    main()
