"""The maps of a scene's floor: where the robot may drive, and which room is where.

A pixel is a square centimetre, the middle of the map is the world's origin, columns run along x, rows along
y, neither turned round. Source: iGibson 1.0 indoor_scene.py, igibson_indoor_scene.py.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.meshes.images import image_size
from langwm_data.scenes.spec import FloorMap, RoomSpec

PIXEL_M = 0.01
CELL_PX = 10
"""Source: turtlebot_point_nav.yaml, trav_map_resolution 0.1 m."""
EROSION_CELLS = 2
"""Source: turtlebot_point_nav.yaml, trav_map_erosion."""
MAX_SIDE_PX = 10_000
"""100 m."""

_FREE = 255
_COLOR_TYPE_AT, _IS_PALETTE = 25, b"\x03"
"""Of a PNG. Source: ISO/IEC 15948, IHDR."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class RoomMap:
    """The rooms of a floor and where each of them is."""

    rooms: tuple[RoomSpec, ...]
    number: NDArray[np.int32]
    """(Y, X): at each pixel the index of the room that it lies in or that is nearest to it."""

    def rooms_at(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """(N,), the index of the room at each of the points (N, 2)."""
        size = self.number.shape[0]
        pixels = np.floor(points / PIXEL_M + size / 2).astype(int)
        column, row = np.clip(pixels, 0, size - 1).T
        return self.number[row, column]


def read_floor_map(data: DataFolder, layout: str) -> FloorMap:
    """Where the building lets a robot drive, furniture aside: that is solid in any case.

    The map of free floor without that of obstacles, both without objects, in cells of 0.1 m that are free
    throughout after erosion, as far as they hang together.

    Raises:
        ValueError: If a map is missing, damaged or too large, or nothing is free.
    """
    free = _read_map(data, f"{layout}/floor_trav_no_obj_0.png")
    obstacles = _read_map(data, f"{layout}/floor_no_obj_0.png")
    if free.shape != obstacles.shape:
        raise ValueError(f"{layout}: the maps floor_trav_no_obj_0 and floor_no_obj_0 are of different sizes")
    size = len(free) // CELL_PX
    cells = cv2.resize(np.where(obstacles == 0, 0, free).astype(np.uint8), (size, size))
    cells = cv2.erode(cells, np.ones((EROSION_CELLS, EROSION_CELLS)))
    mask = _largest(np.asarray(cells) == _FREE)
    if not mask.any():
        raise ValueError(f"{layout}/floor_trav_no_obj_0.png: nothing is free")
    corner = -size / 2 * CELL_PX * PIXEL_M
    return FloorMap.of_mask(mask.T, origin=(corner, corner), resolution_m=CELL_PX * PIXEL_M)


def read_rooms(data: DataFolder, layout: str, kinds: Sequence[str]) -> RoomMap:
    """The rooms that the instance map shows, called as scenes call them: ``bedroom_0``.

    Args:
        data: The dataset.
        layout: Folder of the maps.
        kinds: What ``room_categories.txt`` lists; number 1 of the semantic map is the first.

    Raises:
        ValueError: If a map is missing, damaged or too large, or shows a kind that is not listed.
    """
    path = f"{layout}/floor_semseg_0.png"
    instances, semantic = _read_map(data, f"{layout}/floor_insseg_0.png"), _read_map(data, path)
    if instances.shape != semantic.shape:
        raise ValueError(f"{layout}: the maps floor_insseg_0 and floor_semseg_0 are of different sizes")
    coarse, coarse_kind = _nearest(instances), _nearest(semantic)
    rooms, numbers, counts = [], {}, {}
    for instance in np.unique(coarse[coarse > 0]).tolist():
        kind = int(coarse_kind[tuple(np.argwhere(coarse == instance)[0])])
        if not 1 <= kind <= len(kinds):
            raise ValueError(f"{path}: shows room kind {kind}; room_categories.txt lists {len(kinds)}")
        name = f"{kinds[kind - 1]}_{counts.setdefault(kind, 0)}"
        counts[kind] += 1
        numbers[instance] = len(rooms)
        rooms.append(RoomSpec(name=name, kind=kinds[kind - 1], rect=_rect(instances == instance)))
    if not rooms:
        raise ValueError(f"{layout}/floor_insseg_0.png: shows no room")
    return RoomMap(rooms=tuple(rooms), number=_spread(instances, numbers))


def _read_map(data: DataFolder, path: str) -> NDArray[np.uint8]:
    content = data.read(path)
    width, height = image_size(content, path)
    if width != height or width > MAX_SIDE_PX:
        raise ValueError(
            f"{path}: a map of {width} x {height} pixels; allowed: square, at most {MAX_SIDE_PX} a side"
        )
    content, has_palette = _with_plain_palette(content)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{path}: a damaged map")
    if has_palette:
        image = image[..., 0]
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ValueError(
            f"{path}: a map of shape {image.shape} {image.dtype}; allowed: one channel of 8 bits"
        )
    return image.astype(np.uint8, copy=False)


def _with_plain_palette(png: bytes) -> tuple[bytes, bool]:
    """A PNG whose palette, if it has one, gives every number the grey of that number; whether it has one.

    A map in the colours of a palette means their numbers, which decoders replace.
    """
    at = png.find(b"PLTE")
    if png[_COLOR_TYPE_AT : _COLOR_TYPE_AT + 1] != _IS_PALETTE or at < 4:
        return png, False
    (length,) = struct.unpack(">I", png[at - 4 : at])
    chunk = b"PLTE" + bytes(np.repeat(np.arange(length // 3, dtype=np.uint8), 3))
    return png[:at] + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[at + len(chunk) + 4 :], True


def _largest(free: Mask) -> Mask:
    """The largest part that hangs together by edges or corners."""
    labels: NDArray[np.int32] = ndimage.label(free, np.ones((3, 3)))[0]  # pyright: ignore
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return free & np.equal(labels, int(sizes.argmax()))


def _nearest(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """One pixel of each cell, near its middle: rooms are numbered by what is left of them."""
    size = max(len(image) // CELL_PX, 1)
    at = ((np.arange(size) + 0.5) * len(image) / size).astype(int)
    return image[np.ix_(at, at)]


def _rect(mask: Mask) -> tuple[float, float, float, float]:
    half = len(mask) / 2
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    edges = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) - half
    x0, y0, x1, y1 = np.round(edges * PIXEL_M, 6).tolist()
    return (x0, y0, x1, y1)


def _spread(instances: NDArray[np.uint8], numbers: dict[int, int]) -> NDArray[np.int32]:
    table = np.full(256, -1, np.int32)
    table[list(numbers)] = list(numbers.values())
    number = table[instances]
    _, (rows, columns) = ndimage.distance_transform_edt(number < 0, return_indices=True)  # pyright: ignore
    return number[rows, columns]
