"""Do three renderers see the same? Ids and depth of the same views by ``gl``, ``embree`` and ``tiny``.

Views of procedural homes, of homes with catalogue furniture and of scenes in iGibson's layout, in turn on all
their floors. Per pair of renderers: the share of pixels whose ids are equal, and of those the share
whose depth agrees within the limit (2 mm; 30 mm beside ``tiny``), over all views and for the worst of them.

    python benchmarks/agreement.py [--views 200] [--furniture DIR] [--igibson DIR] [--json FILE]

Without ``--igibson`` the small dataset that the tests write stands in for a copy of iGibson.
"""

import argparse
import itertools
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from langwm_data.baking import open_scenes
from langwm_data.config import CameraConfig, RenderConfig, RobotConfig, ScenesConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import describe_renderer, make_renderer

LIMIT_M = {"gl": 0.002, "embree": 0.002, "tiny": 0.03}
SUPPORT = Path(__file__).resolve().parents[1] / "tests" / "support"


def usable_backends() -> list[str]:
    """Those that open on this machine."""
    usable = []
    for name in LIMIT_M:
        try:
            print(f"{name}: {describe_renderer(RenderConfig(backend=name))}")
            usable.append(name)
        except ConfigError as error:
            print(f"{name}: not here ({error})")
    return usable


def draw_views(config: ScenesConfig, count: int):
    """(scene, assets, camera) of random places and directions, in turn on all floors."""
    library, rng = open_scenes(config), np.random.default_rng(0)
    names = library.names()
    for number, name in enumerate(names):
        scene = library.load(name)
        free = FreeSpace.from_scene(scene, robot=RobotConfig())
        for _ in range(len(range(number, count, len(names)))):
            place = tuple(free.sample(rng).tolist())
            yield (
                scene,
                library.assets,
                Camera.on_robot(CameraConfig(), place, float(rng.uniform(-np.pi, np.pi))),
            )


def compare(config: ScenesConfig, count: int, backends: list[str]) -> list[dict]:
    """Each pair of renderers on the views of one kind of scenes."""
    pairs = list(itertools.combinations(backends, 2))
    found: dict[tuple[str, str], list[tuple[float, float]]] = {pair: [] for pair in pairs}
    renderers, held, triangles = {}, None, {}
    for scene, assets, camera in draw_views(config, count):
        if held != scene.name:
            for renderer in renderers.values():
                renderer.close()
            renderers = {b: make_renderer(RenderConfig(backend=b), assets) for b in backends}
            for renderer in renderers.values():
                renderer.load(scene)
            held, triangles[scene.name] = scene.name, num_triangles(scene, assets)
        frames = {name: renderer.render(camera) for name, renderer in renderers.items()}
        for a, b in pairs:
            same = frames[a].instance == frames[b].instance
            limit = max(LIMIT_M[a], LIMIT_M[b])
            near = np.abs(frames[a].depth - frames[b].depth)[same] <= limit
            found[a, b].append((same.mean(), near.mean()))
    print(f"  {len(triangles)} floors, {min(triangles.values())} to {max(triangles.values())} triangles")
    rows = []
    for (a, b), shares in found.items():
        ids, depth = np.array(shares).T
        rows.append(
            {"pair": f"{a}/{b}", "views": len(ids), "ids": ids.mean(), "ids_worst": ids.min()}
            | {"depth": depth.mean(), "depth_worst": depth.min(), "limit_m": max(LIMIT_M[a], LIMIT_M[b])}
        )
        print(
            f"  {a + '/' + b:12} ids {ids.mean():.5%} (worst view {ids.min():.3%}), depth within"
            f" {1000 * max(LIMIT_M[a], LIMIT_M[b]):g} mm {depth.mean():.5%} (worst {depth.min():.3%})"
        )
    return rows


def num_triangles(scene, assets) -> int:
    from langwm_data.sim.scene_mesh import scene_mesh

    return len(scene_mesh(scene, assets).triangles)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--views", type=int, default=200, help="of each kind of scenes")
    parser.add_argument("--furniture", help="folder of Sweet Home 3D catalogues")
    parser.add_argument("--igibson", help="folder of a copy of iGibson 1.0")
    parser.add_argument("--json", type=Path, help="write the figures there")
    args = parser.parse_args()
    backends, results = usable_backends(), {}
    with tempfile.TemporaryDirectory() as folder:
        kinds = {"homes": ScenesConfig()}
        if args.furniture:
            kinds["furnished homes"] = ScenesConfig(furniture=args.furniture)
        if not args.igibson:
            sys.path.append(str(SUPPORT))
            from igibson_dataset import write_dataset

            write_dataset(Path(folder))
        kinds["iGibson's layout"] = ScenesConfig(igibson=args.igibson or folder)
        for name, config in kinds.items():
            print(f"{name}:")
            results[name] = compare(config, args.views, backends)
    if args.json:
        args.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
