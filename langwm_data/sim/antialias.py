"""Antialiased colours from one shaded sample a pixel, and a look at which faces lie around it.

A pixel is the mean of its four quarters. Faces are convex, so where a pixel and its three neighbours on
the side of a quarter all show one face, the quarter shows it too. For the other quarters it is looked up
which face lies at their middle, and they take the colour of the nearest pixel whose centre shows that
face. Colours within a face are smooth already, by mip mapping.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

QUARTERS = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
"""Row and column, in quarters of a pixel from its centre."""
_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))
"""Row and column steps, the nearest first."""

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
    corners = np.stack([mixed[:-1, :-1], mixed[:-1, 1:], mixed[1:, :-1], mixed[1:, 1:]])
    number, pixel = np.divmod(np.flatnonzero(corners), faces.size)
    return OpenQuarters(number=number, pixel=pixel)


def smooth_edges(rgb: NDArray[np.uint8], faces: Faces, quarters: OpenQuarters, seen: Faces) -> None:
    """Give pixels the mean colour of their quarters, in place.

    Args:
        rgb: (H, W, 3), the colour at the centre of each pixel.
        faces: (H, W), the face there.
        quarters: What ``find_open_quarters`` finds in ``faces``.
        seen: (Q,), the face at the middle of each of them. One that no neighbour shows counts as the
            pixel's own.
    """
    is_other = seen != faces.ravel()[quarters.pixel]
    number, pixel, seen = quarters.number[is_other], quarters.pixel[is_other], seen[is_other]
    colors = rgb.reshape(-1, 3)
    change = colors[_sources(faces, pixel, seen)].astype(np.int16) - colors[pixel]
    total = np.zeros(colors.shape, np.int16)
    bounds = np.searchsorted(number, np.arange(len(QUARTERS) + 1))
    for start, stop in pairwise(bounds.tolist()):
        total[pixel[start:stop]] += change[start:stop]
    colors += ((total + 2) // 4).astype(np.uint8)  # modulo 256, as sums of bytes are


def _sources(faces: Faces, pixel: Indices, wanted: Faces) -> Indices:
    """(Q,): the pixel nearest to each ``pixel`` that shows the face ``wanted``, or itself if none does."""
    width = faces.shape[1]
    framed = np.pad(faces, 1, constant_values=-1).ravel()
    in_frame = pixel + 2 * (pixel // width) + width + 3
    source = pixel.copy()
    is_open = np.arange(len(pixel))
    for row, column in _NEIGHBOURS:
        is_there = framed[in_frame[is_open] + row * (width + 2) + column] == wanted[is_open]
        source[is_open[is_there]] += row * width + column
        is_open = is_open[~is_there]
    return source
