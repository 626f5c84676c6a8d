"""Unpack the pictures of a sample quickly: three quarters of reading one is this.

The generator writes PNG without row filters, so the pixels are what inflating gives, less one byte a row.
Every other PNG is left to a general decoder; what a sample may hold is the business of ``strict_png``.
"""

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.png import SIGNATURE

_HEAD = struct.Struct(">8sI4sIIBBBBB")
_FIRST_CHUNK = 33
"""Behind the signature and the header chunk."""
_FORMATS = {np.uint8: (8, 2), np.uint16: (16, 0)}
"""Bits and colour type: RGB of 8 bits, gray of 16."""


def decode_unfiltered(data: bytes, dtype: type[np.uint8 | np.uint16]) -> NDArray[Any] | None:
    """The image in ``data``: RGB (H, W, 3) for uint8, gray (H, W) for uint16; ``None`` if it needs more.

    No more is unpacked than the size in the header asks for: check that before.

    Source: PNG specification, third edition, sections 5, 7, 9 and 11.
    """
    if len(data) < _FIRST_CHUNK:
        return None
    signature, length, kind, width, height, *others = _HEAD.unpack_from(data)
    if (signature, length, kind) != (SIGNATURE, 13, b"IHDR") or tuple(others) != (*_FORMATS[dtype], 0, 0, 0):
        return None
    row_bytes = 1 + width * (3 if dtype is np.uint8 else 2)
    packed = _pixel_stream(data)
    unpacked = None if packed is None else _inflate(packed, height * row_bytes)
    if unpacked is None:
        return None
    rows = np.frombuffer(unpacked, np.uint8).reshape(height, row_bytes)
    if rows[:, 0].any():
        return None
    pixels = rows[:, 1:].copy()
    if dtype is np.uint8:
        return pixels.reshape(height, width, 3)
    return pixels.view(">u2").astype(np.uint16)


def _pixel_stream(data: bytes) -> bytes | None:
    """The bodies of all chunks between header and end; ``None`` if one is not of pixels."""
    bodies, offset = [], _FIRST_CHUNK
    while offset + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        if kind == b"IEND":
            return b"".join(bodies)
        if kind != b"IDAT":
            return None
        bodies.append(data[offset + 8 : offset + 8 + length])
        offset += 12 + length
    return None


def _inflate(packed: bytes, size: int) -> bytes | None:
    """``size`` bytes whose checksum is right, else ``None``."""
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(packed, size + 1)
    except zlib.error:
        return None
    return unpacked if len(unpacked) == size and stream.eof else None
