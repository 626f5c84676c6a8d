"""Videos of episodes and maps of all ways driven on a floor, for whoever wants to see what numbers hide."""

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

import cv2
import gymnasium
import numpy as np
from jaxtyping import UInt8

from agent.envs.episode_file import EpisodeSet
from agent.envs.episodes import Episode
from agent.envs.pointnav import PointNavEnv
from agent.envs.protocols import success_radius
from agent.envs.sites import load_scene
from agent.figures import Walk
from agent.rollout import Policy
from agent.scoring.floorplans import FloorPicture, Picture
from agent.scoring.players import Player
from agent.scoring.rows import Row
from langwm_data import atomic
from langwm_data.png import encode_png

VIDEO_FOLDER = "videos"
MAP_FOLDER = "maps"
HEIGHT_PX = 288
MAP_HEIGHT_PX = 640
WALKS_PER_MAP = 24
LAST_FRAME_REPEATS = 10


def film(player: Player, episodes: EpisodeSet, count: int) -> list[Path]:
    """Play some episodes again and write an MP4 of each: the robot's view beside the map.

    The episodes are spread over floors and distances; playing them again gives what was scored.
    """
    chosen = [episodes.episodes[i] for i in _spread(len(episodes.episodes), count)]
    written, agent = [], player.load()
    for episode in chosen:
        path = player.out / VIDEO_FOLDER / f"{episodes.split}-{episode.scene}-{episode.palette_seed}.mp4"
        scene = load_scene(episode.scene, player.env)
        with contextlib.closing(PointNavEnv(player.env, episodes.split, scenes=[scene])) as env:
            frames = list(_frames(*player.enter(env, agent), episode))
        write_video(path, frames, float(env.metadata["render_fps"]))
        written.append(path)
    return written


def write_maps(player: Player, episodes: EpisodeSet, rows: Sequence[Row]) -> list[Path]:
    """Write a PNG of every floor with the first ways that were driven on it."""
    written = []
    for name in episodes.scenes:
        walks = [walk_of(row) for row in rows if row["scene"] == name][:WALKS_PER_MAP]
        if walks:
            plan = FloorPicture(load_scene(name, player.env), MAP_HEIGHT_PX)
            path = player.out / MAP_FOLDER / f"{episodes.split}-{name}.png"
            atomic.write_bytes(path, encode_png(plan.draw(walks, success_radius(player.env)[1])))
            written.append(path)
    return written


def walk_of(row: Row) -> Walk:
    """The way of an episode."""
    positions = np.array(row["trajectory"].as_py())[:, :2]
    return Walk(positions=positions, goal=(row["goal"][0], row["goal"][1]), is_success=row["success"])


def write_video(path: Path, frames: Sequence[Picture], frames_per_s: float) -> None:
    """Write frames of one size as MP4.

    Raises:
        OSError: If this build of OpenCV writes no such video.
    """
    height, width = (side - side % 2 for side in frames[0].shape[:2])
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "video.mp4"
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(place), codec, frames_per_s, (width, height))
        if not writer.isOpened():
            raise OSError("OpenCV cannot write MP4 here; install opencv-python-headless from PyPI")
        for frame in frames:
            writer.write(np.ascontiguousarray(frame[:height, :width, ::-1]))
        writer.release()
        atomic.write_bytes(path, place.read_bytes())


def _frames(env: gymnasium.Env, policy: Policy, episode: Episode) -> Iterator[Picture]:
    obs, info = env.reset(options={"episode": episode})
    world = cast("PointNavEnv", env.unwrapped)
    plan = FloorPicture(load_scene(episode.scene, world.config), HEIGHT_PX)
    best, poses, state, is_over = world.field.path(episode.start_xy), [info["pose"]], None, False
    goal, radius_m = (float(info["goal"][0]), float(info["goal"][1])), success_radius(world.config)[1]
    while True:
        positions = np.stack(poses)[:, :2]
        walk = Walk(positions=positions, goal=goal, is_success=bool(info["success"]) or not is_over)
        frame = np.concatenate([_view(obs["rgb"]), plan.draw([walk], radius_m, best)], axis=1)
        if is_over:
            break
        yield frame
        action, state = policy(obs, state)
        obs, _, terminated, truncated, info = env.step(action)
        poses.append(info["pose"])
        is_over = terminated or truncated
    yield from [frame] * LAST_FRAME_REPEATS


def _view(rgb: Picture) -> UInt8[np.ndarray, "H2 W2 3"]:
    width = round(HEIGHT_PX * rgb.shape[1] / rgb.shape[0])
    return cv2.resize(rgb, (width, HEIGHT_PX), interpolation=cv2.INTER_NEAREST)


def _spread(num: int, count: int) -> list[int]:
    """``count`` of ``num`` things, evenly and from all tiers, which take turns."""
    count = min(num, count)
    return sorted({min(num - 1, (i * num) // count + i % 3) for i in range(count)})
