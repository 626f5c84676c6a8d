"""Draw frames of a dataset again from what is stored, and compare them pixel by pixel.

Owns the last proof: labels and captions may agree with images that show another scene; here the baked
scene, the stored camera and the stored materials have to give the stored pixels.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import CameraConfig, DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.labels.amodal import SceneSolids, amodal_extents, scene_solids
from langwm_data.pipeline import fingerprint
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.findings import Finding
from langwm_data.shards.manifest import GENERATOR, Manifest
from langwm_data.shards.sample import DatasetError, Sample, to_millimetres
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Renderer
from langwm_data.sim.lights import Lights
from langwm_data.sim.render import make_renderer

_SHARE_TOLERANCE = 1e-6


def require_same_generator(manifest: Manifest) -> DatasetConfig:
    """The configuration of a dataset that this very program would render in the same way.

    Raises:
        DatasetError: If it was made by another version or renderer, or not with the configuration it names.
    """
    config = build_config(DatasetConfig, manifest.config)
    if fingerprint(config, manifest) != manifest.fingerprint:
        raise DatasetError(
            f"the dataset by {manifest.generator} with renderer {manifest.renderer!r} has another fingerprint"
            f" than {GENERATOR} gives it here, so its frames cannot be drawn again"
        )
    return config


def redraw_frames(
    path: Path | str, count: int, *, progress: Callable[[int, int], None] | None = None
) -> tuple[Finding, ...]:
    """Draw ``count`` frames again, spread evenly over the dataset.

    Args:
        path: Folder that holds ``dataset.json``.
        count: How many frames; at most all are drawn.
        progress: Called with frames done and frames in all.

    Raises:
        DatasetError: If the dataset cannot be opened, or was made by another version or renderer.
    """
    dataset = ShardDataset(path)
    config = require_same_generator(dataset.manifest)
    count = min(count, len(dataset))
    numbers = np.linspace(0, len(dataset) - 1, count).round().astype(int).tolist()
    shards = dataset.frames["shard"].to_pylist()
    findings = []
    renderer = make_renderer(config.render, dataset.assets)
    try:
        for done, number in enumerate(numbers, start=1):
            where, key = shards[number], dataset.keys[number]
            try:
                faults = list(_differences(renderer, dataset, dataset[number], config.camera))
            except ValueError as error:
                faults = [f"cannot be drawn again: {error}"]
            findings += [Finding(where=where, key=key, what=fault) for fault in faults]
            if progress is not None:
                progress(done, count)
    finally:
        renderer.close()
    return tuple(findings)


def _differences(
    renderer: Renderer, dataset: ShardDataset, sample: Sample, config: CameraConfig
) -> Iterator[str]:
    stored = sample.meta["camera"]
    x, y = (row[3] for row in stored["camera_to_world"][:2])
    camera = Camera.on_robot(config, (x, y), stored["yaw_rad"])
    if not np.allclose(camera.camera_to_world, stored["camera_to_world"], rtol=0, atol=1e-9):
        yield "its camera is not where the robot's is"
        return
    scene = dataset.scene(sample.meta["scene"])
    renderer.load(scene.with_palette(scene.read_palette(sample.meta["palette"])))
    renderer.set_lights(Lights.parse(sample.meta["lights"]))
    frame = renderer.render(camera)
    yield from _image_difference("rgb", frame.rgb, sample.rgb)
    yield from _image_difference("depth in mm", to_millimetres(frame.depth), to_millimetres(sample.depth))
    yield from _image_difference("instance", frame.instance, sample.instance)
    yield from _extent_differences(scene_solids(scene, dataset.assets), camera, sample.meta["objects"])


def _extent_differences(solids: SceneSolids, camera: Camera, objects: list[dict[str, Any]]) -> Iterator[str]:
    """Whether silhouettes give the stored shares of what is visible, truncated and occluded."""
    areas = {obj["instance"]: obj["area_px"] for obj in objects}
    extents = amodal_extents(solids, camera, areas)
    for obj in objects:
        for name, share in vars(extents[obj["instance"]]).items():
            if abs(obj[name] - share) > _SHARE_TOLERANCE:
                yield f"object {obj['instance']}: {name} is {obj[name]!r}; its silhouette says {share!r}"


def _image_difference(name: str, drawn: NDArray[Any], stored: NDArray[Any]) -> Iterator[str]:
    if drawn.shape != stored.shape:
        yield f"{name} is drawn again as {drawn.shape}, stored as {stored.shape}"
        return
    difference = np.abs(drawn.astype(np.int64) - stored).reshape(*drawn.shape[:2], -1).max(axis=-1)
    if pixels := np.count_nonzero(difference):
        yield f"{name} drawn again differs in {pixels} pixels, by up to {difference.max()}"
