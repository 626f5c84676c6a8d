"""Make the frames of a dataset: choose a view, render it, label it.

Owns what one worker does with one task. Which frames there are stands in ``plan``, where cameras stand in
``views`` and ``trajectories``; processes and completeness stand in ``workers`` and ``shards.writer``.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError
from langwm_data.labels.amodal import AmodalExtent, SceneSolids, amodal_extents, scene_solids
from langwm_data.labels.instances import ObjectLabel, label_frame
from langwm_data.looks import Occasion, draw_lights, draw_palette, lights_occasion, palette_occasion
from langwm_data.plan import FramePlan, ShardTask, plan_frame
from langwm_data.scenes.assets import ASSETS_DIR, Assets
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import InstanceName, SceneSpec, Split
from langwm_data.scenes.splits import check_models, check_palette
from langwm_data.seeding import make_rng
from langwm_data.shards.sample import Sample, to_metres, to_millimetres
from langwm_data.shards.scenes import read_scene, write_scene
from langwm_data.shards.writer import write_shard
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame
from langwm_data.sim.lights import Lights
from langwm_data.sim.render import make_renderer
from langwm_data.trajectories import Pose, simulate_trajectory
from langwm_data.views import Sights, View, camera_space, draw_views
from langwm_data.workers import Report


@dataclass(frozen=True, kw_only=True)
class BakeTask:
    """Build one floor, let its loose objects come to rest, and write it down."""

    scene: str
    physics: str
    """What they come to rest by, as the fingerprint says; see ``SceneLibrary.physics``."""


@dataclass(frozen=True, kw_only=True)
class Floor:
    """One baked scene with what every frame of it needs."""

    scene: SceneSpec
    free: FreeSpace
    """Where the camera may be."""
    sights: Sights
    table: dict[int, InstanceName]
    """By instance id."""
    solids: SceneSolids


@dataclass(frozen=True, kw_only=True)
class Look:
    """What the renderer holds: a floor in one choice of materials and lights."""

    occasions: tuple[Occasion, Occasion]
    """Those of materials and of lights."""
    scene: SceneSpec
    described: dict[str, Any]
    """Scene, materials and lights as they stand in the JSON of every sample that shows them."""


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A view with what it shows."""

    view: View
    camera: Camera
    frame: Frame
    labels: list[ObjectLabel]


class RenderWorker:
    """Does ``BakeTask`` and ``ShardTask`` for one dataset; holds one renderer."""

    def __init__(self, config: DatasetConfig, folder: Path) -> None:
        self._config = config
        self._folder = folder
        self._assets = Assets(folder / ASSETS_DIR)
        self._floors: dict[str, Floor] = {}
        self._shown: Look | None = None
        self._drive: tuple[Split, int, list[Pose]] | None = None
        """Split, number and poses of the last trajectory: its frames mostly come one after the other."""

    def __enter__(self) -> Self:
        self._renderer = make_renderer(self._config.render, self._assets)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._renderer.close()

    def __call__(self, task: BakeTask | ShardTask, report: Report) -> None:
        """Do one task; ``report`` hears of every finished frame."""
        if isinstance(task, BakeTask):
            library = open_scenes(self._config.scenes, self._config.splits.holds_out)
            if library.physics != task.physics:
                raise ConfigError(
                    f"scene {task.scene!r} would be settled by {library.physics} here;"
                    f" all of its dataset must be by {task.physics}"
                )
            scene = library.load(task.scene)
            library.assets.copy_to(self._folder / ASSETS_DIR, scene)
            write_scene(self._folder, scene)
        else:
            write_shard(self._folder, task.split, task.number, self._samples(task, report))

    def _samples(self, task: ShardTask, report: Report) -> Iterator[Sample]:
        for number in range(task.start, task.stop):
            yield self.make_sample(plan_frame(self._config, task.split, number))
            report(1)

    def make_sample(self, plan: FramePlan) -> Sample:
        """Render and label one frame; depends on the config and the plan alone.

        Of the views that there are for it, the first that shows an object worth a caption is taken, else
        the last.
        """
        look, floor = self._show(plan), self._floor(plan.scene)
        rng = make_rng(self._config.seed, "frame", plan.split, plan.number)
        shot = None
        for view in self._views(plan, floor, rng):
            shot = self._shoot(view, floor, rng)
            if any(label.captions for label in shot.labels):
                break
        assert shot is not None, "there is at least one view"
        extents = amodal_extents(floor.solids, shot.camera, {o.instance: o.area_px for o in shot.labels})
        objects = [describe_object(label, extents[label.instance]) for label in shot.labels]
        return _assemble(plan, look, shot, objects)

    def _views(self, plan: FramePlan, floor: Floor, rng: np.random.Generator) -> Iterator[View]:
        config = self._config
        if config.cameras.mode == "single":
            return draw_views(rng, floor.free, floor.sights, config, plan.scene)
        number, step = divmod(plan.number, config.cameras.trajectory_length)
        pose = self._trajectory(plan.split, number, floor)[step]
        view = View(xy=pose.xy, yaw_rad=pose.yaw_rad, trajectory=number, step=step, action=pose.action)
        return iter((view,))

    def _trajectory(self, split: Split, number: int, floor: Floor) -> list[Pose]:
        if self._drive is None or self._drive[:2] != (split, number):
            rng = make_rng(self._config.seed, "trajectory", split, number)
            poses = simulate_trajectory(rng, floor.free, self._config.cameras.trajectory_length)
            self._drive = split, number, poses
        return self._drive[2]

    def _shoot(self, view: View, floor: Floor, rng: np.random.Generator) -> Shot:
        camera = Camera.on_robot(self._config.camera, view.xy, view.yaw_rad)
        frame = self._renderer.render(camera)
        # Labels are taken from depth as it is stored, so that they can be made again from the shards.
        frame = dataclasses.replace(frame, depth=to_metres(to_millimetres(frame.depth)))
        labels = label_frame(frame.instance, frame.depth, floor.table, self._config.labels, rng)
        return Shot(view=view, camera=camera, frame=frame, labels=labels)

    def _show(self, plan: FramePlan) -> Look:
        """Have the renderer hold this frame's scene, in its materials and lights."""
        config, number = self._config, plan.number
        occasions = palette_occasion(config, plan.split, number), lights_occasion(config, plan.split, number)
        shown = self._shown
        if shown is None or (shown.scene.name, shown.occasions) != (plan.scene, occasions):
            scene = self._draw_scene(plan, occasions[0])
            if shown is not None and shown.scene.name == scene.name:
                self._renderer.set_palette(scene.palette)
            else:
                self._renderer.load(scene)
            lights = draw_lights(config, occasions[1])
            if config.randomize.lights != "fixed":
                self._renderer.set_lights(lights)
            described = describe_look(scene, plan.split, lights)
            self._shown = shown = Look(occasions=occasions, scene=scene, described=described)
        return shown

    def _draw_scene(self, plan: FramePlan, occasion: Occasion) -> SceneSpec:
        scene = self._floor(plan.scene).scene
        scene = scene.with_palette(draw_palette(self._config, occasion, scene, plan.split))
        check_palette(scene, self._config.splits.holds_out)
        return scene

    def _floor(self, name: str) -> Floor:
        """One of the few floors of the dataset; all are kept."""
        if name not in self._floors:
            scene = read_scene(self._folder, name)
            check_models(scene, self._config.splits.holds_out)
            self._floors[name] = Floor(
                scene=scene,
                free=camera_space(scene, self._config),
                sights=Sights.of(scene),
                table=scene.instances(),
                solids=scene_solids(scene, self._assets),
            )
        return self._floors[name]


def _assemble(plan: FramePlan, look: Look, shot: Shot, objects: list[dict[str, Any]]) -> Sample:
    largest = max((obj for obj in objects if obj["captions"]), key=lambda o: o["area_px"], default=None)
    return Sample(
        key=plan.key,
        rgb=shot.frame.rgb,
        depth=shot.frame.depth,
        instance=shot.frame.instance,
        meta={
            **look.described,
            **describe_view(shot.view),
            "camera": describe_camera(shot.camera),
            "objects": objects,
        },
        caption=largest["captions"][0]["text"] if largest else "",
    )


def describe_look(scene: SceneSpec, split: Split, lights: Lights) -> dict[str, Any]:
    """Where a sample was taken, in which materials and lights, as it stands in its JSON."""
    return {
        "scene": scene.name,
        "building": scene.building,
        "floor": scene.floor,
        "split": split,
        "palette": [str(material) for material in scene.palette],
        "lights": lights.describe(),
    }


def describe_view(view: View) -> dict[str, Any]:
    """Pose and drive as they stand in a sample's JSON."""
    return {
        "trajectory": view.trajectory,
        "step": view.step,
        "action": [float(entry) for entry in view.action],
        "pose": [float(view.xy[0]), float(view.xy[1]), float(view.yaw_rad)],
    }


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
