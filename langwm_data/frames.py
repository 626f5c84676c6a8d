"""Make the frames of a dataset: choose a view, render it, label it.

Owns what one worker does with one task. Which frames there are stands in ``plan``; processes and
completeness stand in ``workers`` and ``shards.writer``.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from langwm_data.baking import load_home
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError
from langwm_data.labels.amodal import AmodalExtent, Solid, amodal_extents, scene_solids
from langwm_data.labels.instances import ObjectLabel, label_frame
from langwm_data.plan import FramePlan, ShardTask, plan_frame
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.scenes.splits import check_palette, sample_palette
from langwm_data.seeding import make_rng
from langwm_data.shards.sample import Sample, to_metres, to_millimetres
from langwm_data.shards.scenes import read_scene, write_scene
from langwm_data.shards.writer import write_shard
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import Frame, make_renderer
from langwm_data.workers import Report

_PLACE_TRIES = 200


@dataclass(frozen=True, kw_only=True)
class BakeTask:
    """Build one floor, let its loose objects come to rest, and write it down."""

    scene: str


@dataclass(frozen=True, kw_only=True)
class Floor:
    """One baked scene with what every frame of it needs."""

    scene: SceneSpec
    free: FreeSpace
    table: dict[int, tuple[str, str]]
    """Instance id to category and model."""
    solids: dict[int, Solid]
    """By instance id."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """What consecutive frames have in common: a floor in one choice of materials."""

    split: Split
    number: int
    scene: SceneSpec
    materials: list[str]


class RenderWorker:
    """Does ``BakeTask`` and ``ShardTask`` for one dataset; holds one renderer."""

    def __init__(self, config: DatasetConfig, folder: Path) -> None:
        self._config = config
        self._folder = folder
        self._floors: dict[str, Floor] = {}
        self._shown: Block | None = None

    def __enter__(self) -> Self:
        self._renderer = make_renderer(self._config.render)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._renderer.close()

    def __call__(self, task: BakeTask | ShardTask, report: Report) -> None:
        """Do one task; ``report`` hears of every finished frame."""
        if isinstance(task, BakeTask):
            write_scene(self._folder, load_home(task.scene, self._config.scenes))
        else:
            write_shard(self._folder, task.split, task.number, self._samples(task, report))

    def _samples(self, task: ShardTask, report: Report) -> Iterator[Sample]:
        for number in range(task.start, task.stop):
            yield self.make_sample(plan_frame(self._config, task.split, number))
            report(1)

    def make_sample(self, plan: FramePlan) -> Sample:
        """Render and label one frame; depends on the config and the plan alone.

        Views are drawn until one shows an object worth a caption, at most ``cameras.max_tries`` times.
        """
        block, floor = self._show(plan), self._floor(plan.scene)
        rng = make_rng(self._config.seed, "frame", plan.split, plan.number)
        max_tries = self._config.cameras.max_tries
        for attempt in range(1, max_tries + 1):
            camera = sample_camera(rng, floor.free, self._config, plan.scene)
            frame = self._renderer.render(camera)
            # Labels are taken from depth as it is stored, so that they can be made again from the shards.
            frame = dataclasses.replace(frame, depth=to_metres(to_millimetres(frame.depth)))
            labels = label_frame(frame.instance, frame.depth, floor.table, self._config.labels, rng)
            if attempt == max_tries or any(label.captions for label in labels):
                extents = amodal_extents(floor.solids, camera, {o.instance: o.area_px for o in labels})
                objects = [describe_object(label, extents[label.instance]) for label in labels]
                return _assemble(plan, block, camera, frame, objects)
        raise AssertionError("max_tries is at least 1")

    def _show(self, plan: FramePlan) -> Block:
        """Have the renderer hold the scene and materials of this frame's block."""
        shown = self._shown
        if shown is None or (shown.split, shown.number) != (plan.split, plan.block):
            rng = make_rng(self._config.seed, "palette", plan.split, plan.block)
            scene = self._floor(plan.scene).scene
            scene = scene.with_palette(sample_palette(rng, scene.slots, plan.split))
            check_palette(scene)
            if shown is not None and shown.scene.name == scene.name:
                self._renderer.set_palette(scene.palette)
            else:
                self._renderer.load(scene)
            materials = [str(material) for material in scene.palette]
            shown = Block(split=plan.split, number=plan.block, scene=scene, materials=materials)
            self._shown = shown
        return shown

    def _floor(self, name: str) -> Floor:
        """One of the few floors of the dataset; all are kept."""
        if name not in self._floors:
            scene = read_scene(self._folder, name)
            free = FreeSpace.from_scene(scene, robot=self._config.robot)
            table, solids = scene.instances(), scene_solids(scene)
            self._floors[name] = Floor(scene=scene, free=free, table=table, solids=solids)
        return self._floors[name]


def sample_camera(
    rng: np.random.Generator, free: FreeSpace, config: DatasetConfig, scene_name: str
) -> Camera:
    """A robot's view from a random place, far enough from obstacles, in a random direction.

    Raises:
        ConfigError: If no place on the floor is far enough from obstacles.
    """
    for _ in range(_PLACE_TRIES):
        xy = free.sample(rng)
        if free.clearance(xy) >= config.cameras.min_clearance_m:
            yaw_rad = float(rng.uniform(-np.pi, np.pi))
            return Camera.on_robot(config.camera, (float(xy[0]), float(xy[1])), yaw_rad)
    raise ConfigError(
        f"field 'cameras.min_clearance_m': value {config.cameras.min_clearance_m} leaves no place for the"
        f" camera on {scene_name}"
    )


def _assemble(
    plan: FramePlan, block: Block, camera: Camera, frame: Frame, objects: list[dict[str, Any]]
) -> Sample:
    largest = max((obj for obj in objects if obj["captions"]), key=lambda o: o["area_px"], default=None)
    return Sample(
        key=plan.key,
        rgb=frame.rgb,
        depth=frame.depth,
        instance=frame.instance,
        meta={
            "scene": block.scene.name,
            "building": block.scene.building,
            "floor": block.scene.floor,
            "split": plan.split,
            "palette": block.materials,
            "camera": describe_camera(camera),
            "objects": objects,
        },
        caption=largest["captions"][0]["text"] if largest else "",
    )


def describe_object(label: ObjectLabel, extent: AmodalExtent) -> dict[str, Any]:
    """A label as it stands in a sample's JSON; ``dataclasses.asdict`` takes ten times as long."""
    captions = [{**vars(caption)} for caption in label.captions]
    return {**vars(label), "captions": captions, **vars(extent)}


def describe_camera(camera: Camera) -> dict[str, Any]:
    """A camera as it stands in a sample's JSON."""
    return {
        "height": camera.height,
        "width": camera.width,
        "K": camera.intrinsics.tolist(),
        "camera_to_world": camera.camera_to_world.tolist(),
        "yaw_rad": float(camera.yaw_rad),
        "pitch_rad": float(camera.pitch_rad),
    }
