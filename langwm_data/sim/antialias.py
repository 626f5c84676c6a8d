"""Antialiased colours from one shaded sample a pixel, and a look at which faces lie around it.

A pixel is the mean of its four quarters. Faces are convex, so where a pixel and its three neighbours on
the side of a quarter all show one face, the quarter shows it too. For the other quarters it is looked up
which face lies at their middle, and they take the colour of the nearest pixel whose centre shows that
face. Colours within a face are smooth already, by mip mapping.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

QUARTERS = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
"""Row and column, in quarters of a pixel from its centre."""
_NEIGHBOURS = np.array([(0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1), (0, 0)])
"""Row and column steps, the nearest first, and last the pixel itself, which is taken if no other will do."""

Faces = NDArray[np.int32]
Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class OpenQuarters:
    """Quarters of pixels, of which it is open what they show."""

    number: Indices
    """(Q,), rising, into ``QUARTERS``."""
    pixel: Indices
    """(Q,), counted row by row."""


def find_open_quarters(faces: Faces) -> OpenQuarters:
    """Those that border on another face than the one (H, W) at their pixel's centre."""
    across = np.zeros((faces.shape[0], faces.shape[1] + 1), np.bool_)
    across[:, 1:-1] = faces[:, 1:] != faces[:, :-1]
    down = np.zeros((faces.shape[0] + 1, faces.shape[1]), np.bool_)
    down[1:-1] = faces[1:] != faces[:-1]
    # A corner of pixels is mixed if any two of the four that meet there differ.
    mixed = np.zeros((faces.shape[0] + 1, faces.shape[1] + 1), np.bool_)
    mixed[1:] |= across
    mixed[:-1] |= across
    mixed[:, 1:] |= down
    mixed[:, :-1] |= down
    corners = mixed[:-1, :-1], mixed[:-1, 1:], mixed[1:, :-1], mixed[1:, 1:]
    pixels = [np.flatnonzero(corner) for corner in corners]
    number = np.repeat(np.arange(len(QUARTERS)), [len(pixel) for pixel in pixels])
    return OpenQuarters(number=number, pixel=np.concatenate(pixels))


def smooth_edges(rgb: NDArray[np.uint8], faces: Faces, quarters: OpenQuarters, seen: Faces) -> None:
    """Give pixels the mean colour of their quarters, in place.

    Args:
        rgb: (H, W, 3), the colour at the centre of each pixel.
        faces: (H, W), the face there.
        quarters: What ``find_open_quarters`` finds in ``faces``.
        seen: (Q,), the face at the middle of each of them. One that no neighbour shows counts as the
            pixel's own.
    """
    is_other = np.flatnonzero(seen != faces.ravel()[quarters.pixel])
    if not len(is_other):
        return
    # The quarters of one pixel, one after the other.
    is_other = is_other[np.argsort(quarters.pixel[is_other], kind="stable")]
    pixel, colors = quarters.pixel[is_other], rgb.reshape(-1, 3)
    first = np.flatnonzero(np.append(True, pixel[1:] != pixel[:-1]))
    source = _sources(faces, pixel, seen[is_other])
    change = colors.take(source, axis=0).astype(np.int16) - colors.take(pixel, axis=0)
    total = np.add.reduceat(change, first, axis=0)
    colors[pixel[first]] += ((total + 2) >> 2).astype(np.uint8)  # modulo 256, as sums of bytes are


def _sources(faces: Faces, pixel: Indices, wanted: Faces) -> Indices:
    """(Q,): the pixel nearest to each ``pixel`` that shows the face ``wanted``, or itself if none does."""
    height, width = faces.shape
    framed = np.full((height + 2, width + 2), -1, np.int32)
    framed[1:-1, 1:-1] = faces
    in_frame = pixel + 2 * (pixel // width) + width + 3
    row, column = _NEIGHBOURS.T[..., None]
    is_there = framed.take(in_frame + row * (width + 2) + column) == wanted
    is_there[-1] = True
    return pixel + (row * width + column).ravel()[is_there.argmax(axis=0)]
