"""Is a frame the one that the configuration plans in its place? Number, drive, place, materials, lights.

Pure functions of a document, the configuration and the baked scene. What a picture shows is no part of it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

from langwm_data.config import DatasetConfig
from langwm_data.looks import Occasion, draw_lights, draw_palette, lights_occasion, palette_occasion
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import SceneSpec, Split
from langwm_data.shards.document import SampleDocument
from langwm_data.trajectories import Pose, step_fault
from langwm_data.views import camera_space

_TOLERANCE = 1e-6
"""Processors differ in the last digits of a sine."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a frame of a drive was taken, as its document or the index says."""

    scene: str
    trajectory: int
    step: int
    pose: Pose

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Self:
        """That of a sample."""
        x, y, yaw_rad = document["pose"]
        forward, turn = document["action"]
        pose = Pose(xy=(x, y), yaw_rad=yaw_rad, action=(forward, turn))
        return cls(
            scene=document["scene"], trajectory=document["trajectory"], step=document["step"], pose=pose
        )

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Self:
        """That of a row of the index, which has no use for the action before it."""
        pose = Pose(xy=(row["camera_x"], row["camera_y"]), yaw_rad=row["yaw_rad"])
        return cls(scene=row["scene"], trajectory=row["trajectory"], step=row["step"], pose=pose)


class PlanChecker:
    """Compares frames of one scene with what is planned for them.

    Args:
        config: Of the dataset.
        scene: Baked.
        draws_again: Whether the dataset's materials and lights were drawn as this program draws them.

    Raises:
        ValueError: If there is no place for the camera in the scene.
    """

    def __init__(self, config: DatasetConfig, scene: SceneSpec, *, draws_again: bool) -> None:
        self._config, self._scene, self._draws_again = config, scene, draws_again
        self._space: FreeSpace = camera_space(scene, config)
        self._palette: tuple[Occasion, list[str]] = ((), [])
        self._lights: tuple[Occasion, dict[str, list[float]]] = ((), {})

    def faults(self, document: SampleDocument, split: Split, number: int, before: Place | None) -> list[str]:
        """What is not as planned.

        Args:
            document: Of frame ``number`` of ``split``, in this scene.
            split: See there.
            number: See there.
            before: The frame before this one, where it can be trusted.
        """
        faults = list(self._drive_faults(document, number, before))
        x, y, _ = document["pose"]
        clearance_m = self._config.cameras.min_clearance_m
        if not self._space.is_free((x, y)) or self._space.clearance((x, y)) < clearance_m - _TOLERANCE:
            faults.append(f"the camera at {x:.3f}, {y:.3f} is not {clearance_m} m clear of all obstacles")
        if self._draws_again:
            faults += self._look_faults(document, split, number)
        return faults

    def _drive_faults(self, document: SampleDocument, number: int, before: Place | None) -> Iterator[str]:
        place, length = Place.of_document(document), self._config.cameras.trajectory_length
        is_drive = self._config.cameras.mode == "trajectory"
        planned = divmod(number, length) if is_drive else (-1, 0)
        if (place.trajectory, place.step) != planned:
            yield f"trajectory and step are {place.trajectory}, {place.step}; by its number {planned}"
        elif place.step == 0:
            if place.pose.action != (0.0, 0.0):
                yield f"action is {document['action']} at the start of a drive; allowed: zeros"
        elif not all(-1 <= entry <= 1 for entry in place.pose.action):
            yield f"action is {document['action']}; allowed: -1 to 1"
        elif before is not None and before.trajectory == place.trajectory:
            if before.scene != place.scene:
                yield "its drive goes on in another scene than the frame before"
            elif fault := step_fault(self._space, before.pose, place.pose):
                yield fault

    def _look_faults(self, document: SampleDocument, split: Split, number: int) -> Iterator[str]:
        occasion = palette_occasion(self._config, split, number)
        if self._palette[0] != occasion:
            palette = draw_palette(self._config, occasion, self._scene, split)
            self._palette = occasion, list(map(str, palette))
        for slot, said, drawn in zip(self._scene.slots, document["palette"], self._palette[1], strict=False):
            if said != drawn:
                yield f"slot {slot.name!r} holds {said}; the seed draws {drawn}"
                break
        occasion = lights_occasion(self._config, split, number)
        if self._lights[0] != occasion:
            self._lights = occasion, draw_lights(self._config, occasion).describe()
        lights: Mapping[str, Any] = document["lights"]
        for name, drawn in self._lights[1].items():
            if math.dist(lights[name], drawn) > _TOLERANCE:
                yield f"light {name} is {lights[name]}; the configuration gives {drawn}"
