"""Read a PNG of a sample and nothing else: no other size, depth, chunk, filter or length.

Owns what a PNG of a sample may be. Decoders take the size from the file and allocate it, pass over chunks
that they do not know, and give 8 bits of 16 without a word; here every byte has to be accounted for.
"""

import struct
import zlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.png import SIGNATURE
from langwm_data.shards.findings import foreign
from langwm_data.shards.sample import DatasetError

_COLOR_TYPES = {0: "gray", 2: "RGB", 3: "palette", 4: "gray with alpha", 6: "RGB with alpha"}
_MAX_FILTER = 4


def read_png(data: bytes, shape: tuple[int, ...], dtype: type[np.uint8 | np.uint16]) -> NDArray[Any]:
    """The image in ``data``: gray for (H, W), RGB for (H, W, 3).

    Args:
        data: The file.
        shape: What it has to be.
        dtype: What it has to be.

    Raises:
        DatasetError: If it is not a plain PNG of just that shape and type; nothing larger is unpacked.

    Source: PNG specification, third edition, sections 5, 9 and 11.
    """
    if not data.startswith(SIGNATURE):
        raise DatasetError("is not a PNG")
    chunks = _split_chunks(data)
    kinds = [kind for kind, _ in chunks]
    if kinds[0] != b"IHDR" or kinds[-1] != b"IEND" or set(kinds[1:-1]) != {b"IDAT"}:
        raise DatasetError(f"has the chunks {foreign(b' '.join(kinds))}; allowed: IHDR, IDAT, IEND")
    _check_header(chunks[0][1], shape, dtype)
    row_bytes = int(np.prod(shape[1:])) * np.dtype(dtype).itemsize
    unpacked = _unpack(b"".join(body for _, body in chunks[1:-1]), shape[0] * (row_bytes + 1))
    rows = np.frombuffer(unpacked, np.uint8).reshape(shape[0], row_bytes + 1)
    filters = rows[:, 0]
    if filters.max() > _MAX_FILTER:
        raise DatasetError(f"has a row with filter {filters.max()}; allowed: 0 to {_MAX_FILTER}")
    if filters.any():
        image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))
        return image[..., ::-1] if len(shape) == 3 else image
    big_endian = np.ascontiguousarray(rows[:, 1:]).view(np.dtype(dtype).newbyteorder(">"))
    return big_endian.reshape(shape).astype(dtype)


def _check_header(header: bytes, shape: tuple[int, ...], dtype: type[np.uint8 | np.uint16]) -> None:
    if len(header) != 13:
        raise DatasetError("has a damaged header")
    width, height, bits, color, *others = struct.unpack(">IIBBBBB", header)
    if (height, width) != shape[:2]:
        raise DatasetError(f"is {height} x {width} pixels; allowed: {shape[0]} x {shape[1]}")
    meant_bits, meant_color = np.dtype(dtype).itemsize * 8, 2 if len(shape) == 3 else 0
    if (bits, color) != (meant_bits, meant_color):
        found = _COLOR_TYPES.get(color, "unknown")
        raise DatasetError(f"is {bits}-bit {found}; allowed: {meant_bits}-bit {_COLOR_TYPES[meant_color]}")
    if others != [0, 0, 0]:
        raise DatasetError("is compressed, filtered or interlaced in an unknown way")


def _split_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and content of all chunks, at least one."""
    chunks, offset = [], len(SIGNATURE)
    while offset < len(data) or not chunks:
        if len(data) - offset < 12:
            raise DatasetError("is cut off or has something behind its end")
        size, kind = struct.unpack_from(">I4s", data, offset)
        stop = offset + 8 + size
        if stop + 4 > len(data):
            raise DatasetError("is cut off")
        if zlib.crc32(data[offset + 4 : stop]) != int.from_bytes(data[stop : stop + 4], "big"):
            raise DatasetError(f"has a wrong checksum in its chunk {foreign(kind)}")
        chunks.append((kind, data[offset + 8 : stop]))
        offset = stop + 4
    return chunks


def _unpack(data: bytes, size: int) -> bytes:
    """The compressed stream, which has to hold exactly ``size`` bytes; never more are unpacked."""
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise DatasetError("does not unpack") from error
    if len(unpacked) != size or not stream.eof or stream.unused_data:
        raise DatasetError(f"does not unpack to the {size} bytes of its image")
    return unpacked
