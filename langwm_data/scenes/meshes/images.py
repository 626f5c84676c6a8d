"""Textures from strangers: PNG and JPEG made into small PNGs. Sizes are checked before decoding."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.png import encode_png

MAX_BYTES = 2**25
MAX_PIXELS = 2**26
MAX_SIDE = 512
"""Larger textures are shrunk to this: at a metre's distance a camera of 128 lines sees 155 pixels a metre."""

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_SOLID = 250
"""Alpha above this everywhere counts as none."""
_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG segments that state the size of the picture. Source: ITU-T T.81, table B.1."""
_BARE_MARKERS = frozenset((0x01, *range(0xD0, 0xD9)))


def texture_png(data: bytes, label: str) -> bytes:
    """A texture as an 8-bit PNG in colour, no side longer than ``MAX_SIDE``; alpha is kept where it matters.

    Raises:
        ValueError: If the picture is too large, damaged or neither PNG nor JPEG.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"{label}: {len(data)} bytes of texture; at most {MAX_BYTES} are read")
    width, height = image_size(data, label)
    if width * height > MAX_PIXELS:
        raise ValueError(
            f"{label}: a texture of {width} x {height} pixels; at most {MAX_PIXELS} in all are read"
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(f"{label}: a damaged texture: {error.err}") from error
    if image is None:
        raise ValueError(f"{label}: a damaged texture")
    return _encoded(_shrunk(_colored(np.asarray(image))))


def square_picture(png: bytes, size_px: int, label: str) -> NDArray[np.uint8]:
    """A PNG in colour as a square (size_px, size_px, 3), without its alpha.

    Raises:
        ValueError: If it is damaged.
    """
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise ValueError(f"{label}: a damaged picture")
    how = cv2.INTER_AREA if max(image.shape) > size_px else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (size_px, size_px), interpolation=how), np.uint8)


def image_size(data: bytes, label: str) -> tuple[int, int]:
    """Width and height in pixels as the head of a PNG or JPEG states them.

    Raises:
        ValueError: If it is neither, or broken off.
    """
    try:
        if data.startswith(_PNG):
            width, height = struct.unpack(">II", data[16:24])
            return width, height
        if data.startswith(_JPEG):
            return _jpeg_size(data)
    except (struct.error, IndexError) as error:
        raise ValueError(f"{label}: a texture that breaks off in its head") from error
    raise ValueError(f"{label}: a texture that is neither PNG nor JPEG")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    at = 2
    while True:
        marker = data[at + 1]
        if data[at] != 0xFF or marker == 0xFF:
            at += 1
        elif marker in _BARE_MARKERS:
            at += 2
        elif marker in _FRAME_MARKERS:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]


def _colored(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) or (H, W, 4), red first."""
    if image.dtype == np.uint16:
        image = image >> 8
    pixels = image.astype(np.uint8)
    if pixels.ndim == 2:
        return np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.shape[2] == 4 and pixels[..., 3].min() > _SOLID:
        pixels = pixels[..., :3]
    order = [2, 1, 0, 3][: pixels.shape[2]]
    return pixels[..., order]


def _shrunk(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = image.shape[:2]
    scale = MAX_SIDE / max(height, width)
    if scale >= 1:
        return image
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _encoded(image: NDArray[np.uint8]) -> bytes:
    if image.shape[2] == 3:
        return encode_png(np.ascontiguousarray(image))
    is_written, data = cv2.imencode(".png", image[..., [2, 1, 0, 3]])
    assert is_written
    return data.tobytes()
