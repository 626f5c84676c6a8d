"""How fast are the renderers? Frames a second of one process, and what loading and repainting cost.

Three kinds of scenes: a home of the project's own; `boxes`, 70 boxes in a room; `many`, 130,000 triangles
in a room. Frames are 128 x 160 with colour, depth and ids. Figures are CPU time of this thread, each view's
best of several rounds, so that other work on the machine disturbs little; GPUs are timed by the clock.

    python benchmarks/renderers.py [--backends gl embree tiny] [--seconds 5]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from langwm_data.baking import open_scenes
from langwm_data.config import CameraConfig, RenderConfig, RobotConfig, ScenesConfig
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import (
    MaterialRef,
    MaterialSlot,
    ObjectSpec,
    PartSpec,
    RoomSpec,
    SceneSpec,
    SurfaceSpec,
)
from langwm_data.scenes.splits import sample_palette
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Renderer
from langwm_data.sim.render import describe_renderer, make_renderer
from langwm_data.sim.scene_mesh import scene_mesh

NUM_VIEWS = 32
HOME = "Elm_0"
EDGE_M, HEIGHT_M = 6.0, 2.6
MATERIALS = tuple(f"{name}/{i:02d}" for name in ("wood", "tiles", "fabric", "paint") for i in range(1, 5))
LEVEL = (0.0, 0.0, 0.0, 1.0)


def room(name: str, shape: str, count: int, edge_m: float) -> SceneSpec:
    """A square room with primitives strewn all over it."""
    rng = np.random.default_rng(0)
    half, slots = EDGE_M / 2, len(MATERIALS)
    sides = [((x, y, HEIGHT_M / 2), (0.1, EDGE_M, HEIGHT_M)) for x, y in ((-half, 0), (half, 0))]
    sides += [((x, y, HEIGHT_M / 2), (EDGE_M, 0.1, HEIGHT_M)) for x, y in ((0, -half), (0, half))]
    flat = [((0.0, 0.0, z), (EDGE_M, EDGE_M, 0.1)) for z in (0.0, HEIGHT_M)]
    surfaces = [
        SurfaceSpec(
            instance=i + 1,
            kind="wall",
            room="hall",
            part=PartSpec(shape="box", size=size, position=position, slot=i),
        )
        for i, (position, size) in enumerate(sides + flat)
    ]
    objects = []
    for i in range(count):
        position = tuple(rng.uniform((-half, -half, 0), (half, half, HEIGHT_M)).tolist())
        size = tuple(rng.uniform(edge_m / 2, edge_m, 3).tolist())
        part = PartSpec(shape=shape, size=size, position=(0.0, 0.0, 0.0), slot=i % slots)
        objects.append(
            ObjectSpec(
                instance=i + 10,
                category="box",
                model="box_01",
                room="hall",
                position=position,
                orientation=LEVEL,
                size=size,
                parts=(part,),
            )
        )
    return SceneSpec(
        name=name,
        building=name,
        floor=0,
        split="train",
        height_m=HEIGHT_M,
        rooms=(RoomSpec(name="hall", kind="hall", rect=(-half, -half, half, half)),),
        doorways=(),
        surfaces=tuple(surfaces),
        objects=tuple(objects),
        slots=tuple(MaterialSlot(name=m, categories=(m[:-3],)) for m in MATERIALS),
        palette=tuple(MaterialRef.parse(m) for m in MATERIALS),
    )


def views(scene: SceneSpec) -> list[Camera]:
    rng, config = np.random.default_rng(1), CameraConfig()
    if scene.name == HOME:
        free = FreeSpace.from_scene(scene, robot=RobotConfig())
        places = [tuple(free.sample(rng).tolist()) for _ in range(NUM_VIEWS)]
    else:
        config = CameraConfig(vertical_fov_deg=60, mount_height_m=1.3)
        places = [tuple(p) for p in rng.uniform(-2.5, 2.5, (NUM_VIEWS, 2)).tolist()]
    return [Camera.on_robot(config, xy, float(rng.uniform(-np.pi, np.pi))) for xy in places]


def best_seconds(work: Callable[[Camera], object], cameras: list[Camera], seconds: float, clock) -> float:
    best = np.full(len(cameras), np.inf)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for i, camera in enumerate(cameras):
            start = clock()
            work(camera)
            best[i] = min(best[i], clock() - start)
    return float(best.mean())


def milliseconds(work: Callable[[], object], clock) -> float:
    start = clock()
    work()
    return 1000 * (clock() - start)


def report(renderer: Renderer, scene: SceneSpec, label: str, seconds: float, clock) -> None:
    cameras = views(scene)
    load = milliseconds(lambda: renderer.load(scene), clock)
    first = milliseconds(lambda: renderer.render(cameras[0]), clock)
    for camera in cameras:
        renderer.render(camera)
    rate = 1 / best_seconds(renderer.render, cameras, seconds, clock)
    palette = sample_palette(np.random.default_rng(0), scene.slots, "train")
    repaint = milliseconds(lambda: renderer.set_palette(palette), clock)
    count = len(scene_mesh(scene).triangles)
    print(
        f"{label:20s} {scene.name:6s} {count:7d} triangles  {rate:7.0f} frames/s"
        f"  load {load:7.1f} ms, first frame {first:7.1f} ms, palette {repaint:6.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--backends", nargs="+", default=["gl", "embree", "tiny"])
    parser.add_argument("--seconds", type=float, default=5.0)
    asked = parser.parse_args()
    scenes = [
        open_scenes(ScenesConfig()).load(HOME),
        room("boxes", "box", 70, 0.8),
        room("many", "ellipsoid", 200, 0.9),
    ]
    for backend in asked.backends:
        for is_antialiased in (True, False) if backend != "tiny" else (True,):
            config = RenderConfig(backend=backend, is_antialiased=is_antialiased)
            device = describe_renderer(config)
            in_software = backend != "gl" or "llvmpipe" in device
            renderer = make_renderer(config)
            label = backend + ("" if is_antialiased else ", plain")
            print(f"# {label}: {device}")
            for scene in scenes:
                clock = time.thread_time if in_software else time.perf_counter
                report(renderer, scene, label, asked.seconds, clock)
            renderer.close()


if __name__ == "__main__":
    main()
