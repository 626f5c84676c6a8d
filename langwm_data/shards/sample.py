"""One sample of a dataset: the names of its files and how each is written and read.

Owns the format of the five files. Where they lie in a tar and which samples exist is the business of
``writer`` and ``dataset``.
"""

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.config_io import ConfigError
from langwm_data.labels.semantic import semantic_mask
from langwm_data.png import encode_png
from langwm_data.shards.fast_png import decode_unfiltered

RGB_KEY = "rgb.png"
DEPTH_KEY = "depth.png"
INSTANCE_KEY = "instance.png"
META_KEY = "json"
CAPTION_KEY = "txt"
FIELD_OF_FILE: dict[str, str] = {
    RGB_KEY: "rgb",
    DEPTH_KEY: "depth",
    INSTANCE_KEY: "instance",
    META_KEY: "meta",
    CAPTION_KEY: "caption",
}
"""File key to the field of ``Sample`` that it holds."""
FILE_KEYS = tuple(FIELD_OF_FILE)
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
    millimetres = depth * np.float32(MILLIMETRES)
    np.rint(millimetres, out=millimetres)
    millimetres[~(depth <= MAX_DEPTH_M)] = 0
    return millimetres.astype(np.uint16)


def to_metres(millimetres: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Stored depth in metres."""
    return np.divide(millimetres, np.float32(MILLIMETRES), dtype=np.float32)


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
    return Sample(key=key, **decode_fields({name: files[name] for name in FILE_KEYS}, key))


def decode_fields(files: Mapping[str, bytes], key: str) -> dict[str, Any]:
    """The fields of ``Sample`` that the given files hold, by name.

    Args:
        files: Bytes by file key, some or all of ``FILE_KEYS``.
        key: Name of the sample, for what is said of a damaged one.

    Raises:
        DatasetError: If a file cannot be read, or the images have different sizes.
    """
    fields = {
        FIELD_OF_FILE[name]: _DECODERS[name](data, f"sample {key!r}: {name}") for name, data in files.items()
    }
    sizes = [str(fields[name].shape[:2]) for name in ("rgb", "depth", "instance") if name in fields]
    if len(set(sizes)) > 1:
        raise DatasetError(f"sample {key!r}: its images have sizes {', '.join(sizes[:-1])} and {sizes[-1]}")
    return fields


def _decode_rgb(data: bytes, name: str) -> NDArray[np.uint8]:
    return _decode_png(data, np.uint8, name)


def _decode_depth(data: bytes, name: str) -> NDArray[np.float32]:
    return to_metres(_decode_png(data, np.uint16, name))


def _decode_instance(data: bytes, name: str) -> NDArray[np.uint16]:
    return _decode_png(data, np.uint16, name)


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


def _decode_png(data: bytes, dtype: type[np.uint8 | np.uint16], name: str) -> NDArray[Any]:
    # Before anything is unpacked: a small file may hold a picture that fills the memory.
    if len(data) >= _PNG_SIZE.stop and max(struct.unpack(">II", data[_PNG_SIZE])) > _MAX_SIDE_PX:
        raise DatasetError(f"{name} is larger than {_MAX_SIDE_PX} pixels on a side")
    image = decode_unfiltered(data, dtype)
    return image if image is not None else _decode_any_png(data, dtype, name)


def _decode_any_png(data: bytes, dtype: type[np.uint8 | np.uint16], name: str) -> NDArray[Any]:
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.dtype != dtype or image.shape[2:] != ((3,) if dtype is np.uint8 else ()):
        raise DatasetError(f"{name} is not a PNG of {np.dtype(dtype).name}")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if dtype is np.uint8 else image


_DECODERS: dict[str, Callable[[bytes, str], Any]] = {
    RGB_KEY: _decode_rgb,
    DEPTH_KEY: _decode_depth,
    INSTANCE_KEY: _decode_instance,
    META_KEY: _decode_meta,
    CAPTION_KEY: _decode_caption,
}
