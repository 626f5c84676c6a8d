"""The one place that writes PNG: colour in RGB order, gray and ids as they are.

Rows are stored without filters and packed at the quickest level: 2 % more bytes than level 2 on rendered
rooms, and pixels without filters are read back at once. See ADR-0014.
"""

import base64
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_FILTER_NONE = 0
_GRAY, _RGB = 0, 2


def encode_png(image: NDArray[Any]) -> bytes:
    """PNG bytes of (H, W, 3) uint8 in RGB order, or (H, W) uint8 or uint16. Same image, same bytes.

    Source: PNG specification, third edition, sections 5, 7, 9 and 11.
    """
    is_color = image.ndim == 3
    assert image.dtype == np.uint8 or (image.dtype == np.uint16 and not is_color), image.dtype
    assert not is_color or image.shape[2] == 3, image.shape
    height, width = image.shape[:2]
    pixels = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    rows = np.full((height, 1 + pixels.shape[1]), _FILTER_NONE, np.uint8)
    rows[:, 1:] = pixels
    packer = zlib.compressobj(level=1, memLevel=zlib.DEF_MEM_LEVEL + 1)
    bits, color_type = 8 * image.dtype.itemsize, _RGB if is_color else _GRAY
    return b"".join(
        (
            SIGNATURE,
            *_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, 0)),
            *_chunk(b"IDAT", packer.compress(rows.data) + packer.flush()),
            *_chunk(b"IEND", b""),
        )
    )


def _chunk(kind: bytes, body: bytes) -> tuple[bytes, bytes, bytes, bytes]:
    return struct.pack(">I", len(body)), kind, body, struct.pack(">I", zlib.crc32(body, zlib.crc32(kind)))


def image_address(image: NDArray[Any]) -> str:
    """The same as a ``data:`` address, for pages that hold their pictures."""
    return "data:image/png;base64," + base64.b64encode(encode_png(image)).decode()
