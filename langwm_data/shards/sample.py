"""One sample of a dataset: the names of its files and how each is written and read.

Owns the format of the five files. Where they lie in a tar and which samples exist is the business of
``writer`` and ``dataset``.
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.config_io import ConfigError
from langwm_data.labels.semantic import semantic_mask
from langwm_data.png import encode_png

RGB_KEY = "rgb.png"
DEPTH_KEY = "depth.png"
INSTANCE_KEY = "instance.png"
META_KEY = "json"
CAPTION_KEY = "txt"
FILE_KEYS = (RGB_KEY, DEPTH_KEY, INSTANCE_KEY, META_KEY, CAPTION_KEY)
"""Every file of a sample, in the order in which it lies in the tar."""

KEY_PATTERN = r"[A-Za-z0-9_-]+"
"""What the name of a sample may look like: WebDataset takes the first dot for the end of the name."""

MILLIMETRES = 1000.0
MAX_DEPTH_M = np.iinfo(np.uint16).max / MILLIMETRES


_PNG_SIZE = slice(16, 24)
"""Where a PNG has its width and height. Source: PNG specification, IHDR."""
_MAX_SIDE_PX = 2048
"""As ``CameraConfig`` allows."""


class DatasetError(ConfigError):
    """A dataset that is missing, unfinished or damaged: one sentence that says where."""


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One labelled view."""

    key: str
    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W), metres along the optical axis, whole millimetres, 0 = invalid."""
    instance: NDArray[np.uint16]
    """(H, W), 0 = background."""
    meta: dict[str, Any]
    """The JSON document: scene, split, camera, palette, objects."""
    caption: str
    """One sentence, empty where no object is eligible."""

    def semantic(self, category_ids: Mapping[str, int]) -> NDArray[np.uint8]:
        """The number of each pixel's category, (H, W), 0 = background.

        Args:
            category_ids: The numbers, as the dataset's manifest gives them.
        """
        categories = {obj["instance"]: obj["category"] for obj in self.meta["objects"]}
        return semantic_mask(self.instance, categories, category_ids)


def to_millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth as it is stored. What 16 bits cannot hold (beyond 65.535 m) becomes 0, invalid."""
    return np.where(depth <= MAX_DEPTH_M, np.rint(depth * MILLIMETRES), 0).astype(np.uint16)


def to_metres(millimetres: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Stored depth in metres."""
    return (millimetres / MILLIMETRES).astype(np.float32)


def encode_sample(sample: Sample) -> dict[str, bytes]:
    """The files of a sample, in ``FILE_KEYS`` order. Same sample, same bytes."""
    return {
        RGB_KEY: encode_png(sample.rgb),
        DEPTH_KEY: encode_png(to_millimetres(sample.depth)),
        INSTANCE_KEY: encode_png(sample.instance),
        META_KEY: json.dumps(sample.meta, separators=(",", ":"), allow_nan=False).encode(),
        CAPTION_KEY: sample.caption.encode(),
    }


def decode_sample(files: Mapping[str, Any]) -> Sample:
    """Read back ``encode_sample``.

    Takes what ``webdataset`` yields without a decoder, so ``WebDataset(url).map(decode_sample)``
    gives samples with exact 16-bit depth.

    Args:
        files: Bytes by file key, and the sample's name under ``__key__``.

    Raises:
        DatasetError: If a file is missing or cannot be read.
    """
    key = files.get("__key__", "")
    missing = [name for name in FILE_KEYS if name not in files]
    if missing:
        raise DatasetError(f"sample {key!r} lacks {', '.join(missing)}")
    name = f"sample {key!r}: "
    rgb = _decode_png(files[RGB_KEY], np.uint8, name + RGB_KEY)
    depth = _decode_png(files[DEPTH_KEY], np.uint16, name + DEPTH_KEY)
    instance = _decode_png(files[INSTANCE_KEY], np.uint16, name + INSTANCE_KEY)
    if not rgb.shape[:2] == depth.shape == instance.shape:
        raise DatasetError(f"{name}its images have sizes {rgb.shape[:2]}, {depth.shape} and {instance.shape}")
    return Sample(
        key=key,
        rgb=np.asarray(cv2.cvtColor(rgb, cv2.COLOR_BGR2RGB), np.uint8),
        depth=to_metres(depth),
        instance=instance,
        meta=_decode_meta(files[META_KEY], name + META_KEY),
        caption=_decode_caption(files[CAPTION_KEY], name + CAPTION_KEY),
    )


def _decode_meta(data: bytes, name: str) -> dict[str, Any]:
    try:
        meta = json.loads(data)
    except ValueError as error:
        raise DatasetError(f"{name} is not JSON") from error
    if not isinstance(meta, dict):
        raise DatasetError(f"{name} is not a JSON object")
    return meta


def _decode_caption(data: bytes, name: str) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise DatasetError(f"{name} is not UTF-8") from error


def _decode_png(data: bytes, dtype: type[np.generic], name: str) -> NDArray[Any]:
    # Before anything is unpacked: a small file may hold a picture that fills the memory.
    if len(data) >= _PNG_SIZE.stop and max(struct.unpack(">II", data[_PNG_SIZE])) > _MAX_SIDE_PX:
        raise DatasetError(f"{name} is larger than {_MAX_SIDE_PX} pixels on a side")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.dtype != dtype or image.shape[2:] != ((3,) if dtype is np.uint8 else ()):
        raise DatasetError(f"{name} is not a PNG of {np.dtype(dtype).name}")
    return image
