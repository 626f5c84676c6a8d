"""What features are asked for: the room, what stands in sight, the nearest obstacle, the next frame.

Pure functions of tables, scenes and depth images; a row of every target belongs to a row of the frames.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Int

from langwm_data.config import RobotConfig
from langwm_data.scenes.spec import SceneSpec

NOWHERE = ""
"""Kind of the room of a camera that stands in none, such as in a doorway."""


def room_kinds(frames: pa.Table, scenes: Mapping[str, SceneSpec]) -> list[str]:
    """Kind of the room in which each camera stands.

    Args:
        frames: Rows of a dataset's index.
        scenes: By name.
    """
    places = zip(*(frames[name].to_pylist() for name in ("scene", "camera_x", "camera_y")), strict=True)
    return [_room_kind(scenes[scene], x, y) for scene, x, y in places]


def _room_kind(scene: SceneSpec, x: float, y: float) -> str:
    for room in scene.rooms:
        x0, y0, x1, y1 = room.rect
        if x0 <= x <= x1 and y0 <= y <= y1:
            return room.kind
    return NOWHERE


def categories_present(objects: Sequence[Sequence[str]], names: Sequence[str]) -> Float[np.ndarray, "N K"]:
    """1 where a frame shows an object of a category, else 0.

    Args:
        objects: Per frame, the categories of the objects in it.
        names: The categories asked for.
    """
    return np.array([[float(name in held) for name in names] for held in objects]).reshape(
        len(objects), len(names)
    )


def frequent_categories(
    train: Sequence[Sequence[str]], test: Sequence[Sequence[str]], least_train: int, least_test: int
) -> list[str]:
    """Categories that are both shown and not shown by enough frames of either split, sorted."""
    names = sorted({name for held in train for name in held})
    return [
        name
        for name in names
        if all(
            least <= sum(name in held for held in split) <= len(split) - least
            for split, least in ((train, least_train), (test, least_test))
        )
    ]


def nearest_obstacle(
    depth: Float[np.ndarray, "B H W"],
    intrinsics: Float[np.ndarray, "3 3"],
    camera_z: Float[np.ndarray, " B"],
    pitch_rad: Float[np.ndarray, " B"],
    robot: RobotConfig,
) -> Float[np.ndarray, "B 2"]:
    """Distance in metres and bearing in radians, left positive, of the nearest thing it would hit.

    That is the nearest pixel, over the ground, whose point lies higher than what the robot drives over and
    lower than its top. Not a number where there is none in sight.

    Args:
        depth: Metres along the optical axis, 0 where invalid.
        intrinsics: Of the camera, pixels.
        camera_z: Heights above the floor, metres.
        pitch_rad: Positive looks up.
        robot: Its height and clearance.
    """
    height, width = depth.shape[1:]
    right = (np.arange(width) + 0.5 - intrinsics[0, 2]) / intrinsics[0, 0]
    down = ((np.arange(height) + 0.5 - intrinsics[1, 2]) / intrinsics[1, 1])[:, None]
    cos, sin = np.cos(pitch_rad)[:, None, None], np.sin(pitch_rad)[:, None, None]
    ahead = depth * (cos + down * sin)
    above = camera_z[:, None, None] + depth * (sin - down * cos)
    is_in_way = (depth > 0) & (above > robot.clearance_m) & (above < robot.height_m)
    away = np.where(is_in_way, np.hypot(ahead, depth * right), np.inf).reshape(len(depth), -1)
    nearest = away.argmin(axis=1)
    rows = np.arange(len(depth))
    bearing = np.arctan2(-(depth * right).reshape(len(depth), -1), ahead.reshape(len(depth), -1))
    found = np.stack([away[rows, nearest], bearing[rows, nearest]], axis=1)
    return np.where(np.isfinite(away[rows, nearest])[:, None], found, np.nan)


def next_frames(frames: pa.Table) -> tuple[Int[np.ndarray, "P 2"], Float[np.ndarray, "P A"]]:
    """Pairs of row numbers of one frame and the next of the same drive, and the action in between."""
    names = ("scene", "trajectory", "step", "action")
    rows = list(zip(*(frames[name].to_pylist() for name in names), strict=True))
    at = {(scene, drive, step): i for i, (scene, drive, step, _) in enumerate(rows) if drive >= 0}
    pairs = [(at[key], at[after]) for key in at if (after := (*key[:2], key[2] + 1)) in at]
    actions = [rows[after][3] for _, after in pairs]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2), np.array(actions, dtype=np.float64).reshape(-1, 2)


def number_groups(names: Sequence[object]) -> Int[np.ndarray, " N"]:
    """Equal names get equal numbers, from 0."""
    return np.unique([str(name) for name in names], return_inverse=True)[1].astype(np.int64)
