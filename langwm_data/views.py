"""Where a dataset's cameras stand and look: on free floor, mostly towards something worth a caption.

Owns single views. Drives stand in ``trajectories``; what a view shows is known once it is rendered.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.geometry import Boxes
from langwm_data.scenes.navigation import RESOLUTION_M, FreeSpace
from langwm_data.scenes.spec import SceneSpec
from langwm_data.scenes.taxonomy import is_nameable
from langwm_data.sim.camera import Camera

_PLACE_TRIES = 200
_AREA_MARGIN = 2.0
"""A view is turned to an object when a box of its size would cover this many times the eligible area: part
of it may be hidden, or lie outside the picture."""
_MAX_SHARE = 0.5
"""And at most this share of the picture: closer, there is nothing but the object to be seen."""
_MIDDLE = 0.9
"""The object's middle comes to lie anywhere in this share of the picture's width."""
_SLACK_M = np.array([-1e-6, 1e-6])[:, None, None]
"""Far more than rounding errors: what is looked at only because of it is found not to be in the way."""

Floats = NDArray[np.float64]
XY = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class View:
    """One pose of the robot that carries the camera, and how it came there."""

    xy: XY
    """Metres."""
    yaw_rad: float
    """Counter-clockwise from +x, in [-pi, pi]."""
    trajectory: int = -1
    """Number of the drive in its split; -1 where the view stands alone."""
    step: int = 0
    """Number of the frame in its drive."""
    action: tuple[float, float] = (0.0, 0.0)
    """What led here: forward and turning speed in units of their limits, left positive; zeros at first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """What a view can be turned to, and what may hide it."""

    objects: NDArray[np.int64]
    """(N,), instance ids of nameable objects."""
    bounds: Floats
    """(N, 2, 3), lower and upper corner of each object."""
    boxes: Boxes
    """One around each part of the scene, in whose way a sight line may be."""
    reach: Floats
    """(2, 3, N), lower and upper corner of the axis-aligned box around each of them, and a little more."""
    owners: NDArray[np.int64]
    """Instance id of each box."""

    @classmethod
    def of(cls, scene: SceneSpec) -> Self:
        """Those of one scene."""
        parts = list(scene.iter_parts())
        boxes = Boxes.of_parts((position, orientation, part) for _, position, orientation, part in parts)
        around = boxes.bounds
        owners = np.array([instance for instance, *_ in parts], np.int64)
        objects = np.array([o.instance for o in scene.objects if is_nameable(o.category)], np.int64)
        corners = [around[owners == number] for number in objects]
        bounds = [np.stack([c[:, 0].min(axis=0), c[:, 1].max(axis=0)]) for c in corners]
        return cls(
            objects=objects,
            bounds=np.reshape(bounds, (-1, 2, 3)),
            boxes=boxes,
            reach=np.moveaxis(around, 0, -1) + _SLACK_M,
            owners=owners,
        )

    def is_hidden(self, eye: Floats, point: Floats, instance: int) -> bool:
        """Whether the box of a part of anything else lies between ``eye`` and ``point``, each (3,)."""
        low, high = np.minimum(eye, point)[:, None], np.maximum(eye, point)[:, None]
        may_hide = ((self.reach[0] < high) & (self.reach[1] > low)).all(axis=0) & (self.owners != instance)
        near = np.flatnonzero(may_hide)
        axes, half = self.boxes.axes.take(near, axis=0), self.boxes.half.take(near, axis=0)
        start = ((eye - self.boxes.center.take(near, axis=0))[:, None] @ axes)[:, 0]
        along = (point - eye) @ axes
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-half - start) / along, (half - start) / along
        enters = np.fmax.reduce(np.minimum(one, other), axis=1)
        leaves = np.fmin.reduce(np.maximum(one, other), axis=1)
        return bool((np.maximum(enters, 0.0) < np.minimum(leaves, 1.0)).any())


def camera_space(scene: SceneSpec, config: DatasetConfig) -> FreeSpace:
    """The places on a floor where the camera may be.

    Nothing there is in the way of the robot, nor of the camera where that stands higher. Single views are
    taken wherever the robot can drive, so far as ``cameras.min_clearance_m`` lets them; of a drive's space
    every point of every cell has that clearance.

    Raises:
        ConfigError: If that is nowhere.
    """
    clearance_m, robot = config.cameras.min_clearance_m, config.robot
    is_drive = config.cameras.mode == "trajectory"
    radius_m = clearance_m + RESOLUTION_M / math.sqrt(2) if is_drive else min(clearance_m, robot.radius_m)
    height_m = max(robot.height_m, config.camera.mount_height_m + clearance_m)
    carrier = dataclasses.replace(robot, radius_m=radius_m, height_m=height_m)
    try:
        return FreeSpace.from_scene(scene, robot=carrier)
    except ValueError as error:
        raise _no_place(scene.name, clearance_m) from error


def draw_views(
    rng: np.random.Generator, space: FreeSpace, sights: Sights, config: DatasetConfig, scene_name: str
) -> Iterator[View]:
    """Views for one frame, best first: whoever renders them takes the first that shows enough, or the last.

    Raises:
        ConfigError: If no place on the floor is far enough from obstacles.
    """
    if rng.random() < config.cameras.uniform_fraction:
        yield View(xy=_sample_place(rng, space, config, scene_name), yaw_rad=rng.uniform(-np.pi, np.pi))
        return
    for _ in range(config.cameras.max_tries):
        xy = _sample_place(rng, space, config, scene_name)
        yaw_rad = sample_yaw(rng, sights, xy, config)
        if yaw_rad is None:  # nothing is in sight
            xy, yaw_rad = _sample_place(rng, space, config, scene_name), rng.uniform(-np.pi, np.pi)
        yield View(xy=xy, yaw_rad=yaw_rad)


def sample_yaw(rng: np.random.Generator, sights: Sights, xy: XY, config: DatasetConfig) -> float | None:
    """A direction in which a random object is in sight, neither small nor close; nothing if there is none."""
    camera = Camera.on_robot(config.camera, xy, 0.0)
    aims, areas = _aims(sights, camera)
    is_fit = (areas >= _AREA_MARGIN * config.labels.min_area_fraction) & (areas <= _MAX_SHARE)
    eye = np.array(camera.position)
    for number in rng.permutation(np.flatnonzero(is_fit)):
        if not sights.is_hidden(eye, aims[number], int(sights.objects[number])):
            x, y = (aims[number] - eye)[:2].tolist()
            across_px = rng.uniform(-0.5, 0.5) * _MIDDLE * camera.width
            return math.remainder(math.atan2(y, x) + math.atan2(across_px, camera.focal_px), 2 * math.pi)
    return None


def _aims(sights: Sights, camera: Camera) -> tuple[Floats, Floats]:
    """The middle (N, 3) of what the picture's height leaves of each object, and the share (N,) of the
    picture that a box of that size would cover if the camera faced it.
    """
    low, high = sights.bounds[:, 0], sights.bounds[:, 1]
    aims, extent = (low + high) / 2, (high - low)
    x, y, mount_height_m = camera.position
    far_m = np.maximum(np.hypot(aims[:, 0] - x, aims[:, 1] - y), camera.near_m)
    half_fov = 0.5 * camera.vertical_fov_rad
    steepest = math.radians(89)
    edges = np.clip([camera.pitch_rad - half_fov, camera.pitch_rad + half_fov], -steepest, steepest)
    bottom, top = mount_height_m + far_m * np.tan(edges)[:, None]
    bottom, top = np.maximum(bottom, low[:, 2]), np.minimum(top, high[:, 2])
    aims[:, 2] = (bottom + top) / 2
    px_per_m = camera.focal_px / far_m
    width_px = np.minimum(extent[:, :2].mean(axis=1) * px_per_m, camera.width)
    height_px = np.maximum(top - bottom, 0) * px_per_m
    return aims, width_px * height_px / (camera.width * camera.height)


def _sample_place(rng: np.random.Generator, space: FreeSpace, config: DatasetConfig, scene_name: str) -> XY:
    for _ in range(_PLACE_TRIES):
        place, clearance_m = space.sample_place(rng)
        if clearance_m >= config.cameras.min_clearance_m:
            x, y = place.tolist()
            return x, y
    raise _no_place(scene_name, config.cameras.min_clearance_m)


def _no_place(scene_name: str, clearance_m: float) -> ConfigError:
    return ConfigError(
        f"field 'cameras.min_clearance_m': value {clearance_m} leaves no place for the camera on {scene_name}"
    )
