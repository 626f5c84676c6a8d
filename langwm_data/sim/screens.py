"""Which pieces of a scene a camera cannot see because one wall hides them: nothing of them need be drawn.

NumPy only. A wall hides a piece when the box around the piece lies wholly in its shadow, were the eye a lamp.
That errs towards being seen: pictures are the same with it and without.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.spec import PartSpec
from langwm_data.sim.camera import Camera

MIN_AREA_M2 = 0.3
"""Smaller walls hide little."""
NUM_USED = 8
"""Those that fill most of a view; more of them hide hardly more."""
_MARGIN = 1e-5
"""What grazes the edge of a shadow counts as seen, however numbers are rounded. Metres, times the length of
an edge and the distance to it."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Screens:
    """Rectangles inside solid walls, half way through them.

    A shadow is bounded by four planes, each through the eye and an edge, and by the rectangle's own.
    """

    piece: NDArray[np.intp]
    """(K,), the number of the piece that each lies in."""
    center: Floats
    """(K, 3), metres."""
    normal: Floats
    """(K, 3), unit length."""
    area: Floats
    """(K,), square metres."""
    half_thickness: Floats
    """(K,), of the wall, metres."""
    fixed: Floats
    """(K, 4, 3)."""
    turning: Floats
    """(K, 4, 3, 3): normals of the planes through an eye are fixed + turning @ eye. They point into the
    shadow where the eye is on the side to which the rectangle's normal points, else out of it."""

    def hidden(self, camera: Camera, is_in_view: Bools, center: Floats, half: Floats) -> Bools:
        """Which boxes (N,) no pixel can show.

        Args:
            camera: The view.
            is_in_view: (P,), by the number of a piece: walls that are in view are used.
            center: (N, 3), of each axis-aligned box.
            half: (N, 3), half its extent.
        """
        eye = np.array(camera.position)
        used = self._largest(camera, is_in_view)
        height = ((eye - self.center.take(used, axis=0)) * self.normal.take(used, axis=0)).sum(axis=1)
        side = np.sign(height)[:, None, None]
        edges = self.fixed.take(used, axis=0) + self.turning.take(used, axis=0) @ eye
        planes = np.concatenate([edges, -self.normal.take(used, axis=0)[:, None]], axis=1) * side
        reach = planes @ (center - eye).T - np.abs(planes) @ half.T
        reach[:, 4] -= np.abs(height)[:, None]
        return (reach > _MARGIN).all(axis=1).any(axis=0)

    def _largest(self, camera: Camera, is_in_view: Bools) -> NDArray[np.intp]:
        """The screens in view that fill most of it, as the eye sees them."""
        offset = np.array(camera.position) - self.center
        height = np.abs((offset * self.normal).sum(axis=1))
        # In a wall, or so close that the near plane may cut it, one sees through.
        is_used = is_in_view.take(self.piece) & (height > self.half_thickness + 4 * camera.near_m)
        size = self.area * height / np.maximum((offset * offset).sum(axis=1), 1e-6) ** 1.5
        return np.argsort(-size * is_used)[: min(NUM_USED, np.count_nonzero(is_used))]


def make_screens(walls: Iterable[tuple[int, PartSpec]]) -> Screens:
    """Those of the larger boxes among solid parts in world coordinates, each with the number of its piece."""
    found = []
    for piece, part in walls:
        half = np.asarray(part.size) / 2
        axes = quat_matrix(part.orientation) * half
        thin, *flat = np.argsort(half).tolist()
        area = 4 * half[flat[0]] * half[flat[1]]
        if part.shape == "box" and area >= MIN_AREA_M2:
            across, along = axes[:, flat[0]], axes[:, flat[1]]
            found.append((piece, part.position, axes[:, thin] / half[thin], across, along, area, half[thin]))
    columns = zip(*found, strict=True) if found else ((),) * 7
    piece, center, normal, across, along, area, half_thickness = columns
    center, normal, across, along = (np.reshape(v, (-1, 3)) for v in (center, normal, across, along))
    steps = np.stack([across, along, -across, -along], axis=1)
    edges = np.stack([along, -across, -along, across], axis=1)
    fixed = np.cross(center[:, None] + steps, edges)
    turning = _cross_matrix(edges)
    inwards = np.einsum("kec,kc->ke", fixed + np.einsum("kecd,kd->kec", turning, center + normal), -normal)
    fixed *= np.sign(inwards)[..., None]
    turning *= np.sign(inwards)[..., None, None]
    return Screens(
        piece=np.array(piece, np.intp),
        center=center,
        normal=normal,
        area=np.array(area, np.float64),
        half_thickness=np.array(half_thickness, np.float64),
        fixed=fixed,
        turning=turning,
    )


def _cross_matrix(vectors: Floats) -> Floats:
    """(..., 3, 3): the matrix whose product with a vector is the cross product of ``vectors`` with it."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
