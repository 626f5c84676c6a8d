"""Frames with their features by several encoders, and with the answers to what the features are asked.

Owns which frames are read, and which encoders stand side by side. Nothing is fitted here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import pyarrow as pa
import torch
from jaxtyping import Float, UInt8
from numpy.typing import NDArray

from langwm_data.config import RobotConfig
from langwm_data.config_io import build_config
from pretrain.batch import TextTokens
from pretrain.dataset import FrameDataset
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.targets import nearest_obstacle, number_groups, room_kinds
from pretrain.update import torch_seed

CLS, TOKENS, PIXELS = "CLS", "mean of tokens", "pixels"
PIXEL_STEP = 8
"""Raw pixels are means over squares of this edge."""
_CHUNK = 64

Encoder = Callable[[UInt8[np.ndarray, "B H W 3"]], Mapping[str, Float[np.ndarray, "B F"]]]
"""Frames to features, by the name of the features."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenFrames:
    """Frames of one split with everything that is asked about them, row by row."""

    table: pa.Table
    """Their rows of the dataset's index."""
    rooms: list[str]
    categories: list[list[str]]
    obstacles: Float[np.ndarray, "N 2"]
    """See ``nearest_obstacle``."""
    features: Mapping[tuple[str, str], Float[np.ndarray, "_ _"]]
    """By the names of the encoder and of its features."""

    @cached_property
    def scenes(self) -> NDArray[np.int64]:
        """A number for each scene."""
        return number_groups(self.table["scene"].to_pylist())

    @cached_property
    def drives(self) -> NDArray[np.int64]:
        """A number for each drive; frames of no drive have one of their own."""
        return number_groups(_drive_names(self.table))


def mae_encoder(mae: LanguageGroundedMAE) -> Encoder:
    """CLS and the mean of all other tokens of ``mae.encode``."""

    def encode(rgb: UInt8[np.ndarray, "B H W 3"]) -> dict[str, Float[np.ndarray, "B F"]]:
        tokens = mae.encode(torch.from_numpy(rgb).to(mae.device)).cpu().double().numpy()
        return {CLS: tokens[:, 0], TOKENS: tokens[:, 1:].mean(axis=1)}

    return encode


def random_encoder(mae: LanguageGroundedMAE, seed: int) -> Encoder:
    """The same architecture as it was before it learned anything."""
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(seed, "random encoder"))
        null = TextTokens(embed=mae.null_embed, attend=mae.null_attend)
        fresh = LanguageGroundedMAE(mae.config, mae.text, null)
    return mae_encoder(fresh.to(mae.device).eval())


def encode_pixels(rgb: UInt8[np.ndarray, "B H W 3"]) -> dict[str, Float[np.ndarray, "B F"]]:
    """Colours, made small."""
    height, width = rgb.shape[1:3]
    size = (max(width // PIXEL_STEP, 1), max(height // PIXEL_STEP, 1))
    small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA).ravel() for image in rgb]
    return {PIXELS: np.stack(small).astype(np.float64)}


def choose_frames(rng: np.random.Generator, table: pa.Table, num_frames: int) -> list[int]:
    """Random rows in order, about ``num_frames``; of a drive all frames or none."""
    groups = number_groups(_drive_names(table))
    counts = np.bincount(groups)
    order = rng.permutation(len(counts))
    is_chosen = np.zeros(len(counts), dtype=np.bool_)
    is_chosen[order[: int(np.searchsorted(np.cumsum(counts[order]), num_frames)) + 1]] = True
    return np.flatnonzero(is_chosen[groups]).tolist()


def see_frames(
    frames: FrameDataset,
    numbers: Sequence[int],
    encoders: Mapping[str, Encoder],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> SeenFrames:
    """Read frames once: their features by every encoder, and the answers to every question.

    Args:
        frames: Of one split.
        numbers: Which of them.
        encoders: By name.
        progress: Called with frames read and all frames to read.
    """
    shards = frames.shards
    table = shards.frames.take(numbers)
    intrinsics = np.array(shards.manifest.camera.K)
    robot = build_config(RobotConfig, shards.manifest.config.get("robot", {}))
    heights, pitches = (table[name].to_numpy() for name in ("camera_z", "pitch_rad"))
    obstacles, features = [], {}
    for start in range(0, len(numbers), _CHUNK):
        rows = slice(start, start + _CHUNK)
        batch = frames.batch(numbers[rows])
        obstacles.append(
            nearest_obstacle(batch.depth.astype(np.float64), intrinsics, heights[rows], pitches[rows], robot)
        )
        for encoder, encode in encoders.items():
            for kind, values in encode(batch.rgb).items():
                features.setdefault((encoder, kind), []).append(values)
        progress(min(start + _CHUNK, len(numbers)), len(numbers))
    scenes = {name: shards.scene(name) for name in set(table["scene"].to_pylist())}
    return SeenFrames(
        table=table,
        rooms=room_kinds(table, scenes),
        categories=[[o.category for o in frames.objects[n]] for n in numbers],
        obstacles=np.concatenate(obstacles),
        features={name: np.concatenate(parts) for name, parts in features.items()},
    )


def _drive_names(table: pa.Table) -> list[tuple[str, int, str]]:
    names = (table[name].to_pylist() for name in ("scene", "trajectory", "key"))
    return [(scene, drive, key if drive < 0 else "") for scene, drive, key in zip(*names, strict=True)]
