"""Building blocks of procedural textures: periodic noise, bonds of blocks, scattered cells.

Everything lives on the unit square and wraps around exactly. Row 0 is the top of a picture.
"""

from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

Field = NDArray[np.float64]
Values = TypeVar("Values", bound=NDArray[Any])


def grid(size: int) -> tuple[Field, Field]:
    """U (to the right) and v (downwards) at the pixel centres of a (size, size) picture, in [0, 1)."""
    axis = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(axis, axis)
    return u, v


def mix(a: ArrayLike, b: ArrayLike, weight: Field) -> Field:
    """Colours ``a`` where ``weight`` is 0 and ``b`` where it is 1."""
    w = np.clip(weight, 0, 1)[..., None]
    return np.asarray(a) * (1 - w) + np.asarray(b) * w


def ramp(x: Field, start: float, stop: float) -> Field:
    """0 up to ``start``, 1 from ``stop`` on, smooth in between."""
    t = np.clip((x - start) / (stop - start), 0, 1)
    return t * t * (3 - 2 * t)


def noise(
    rng: np.random.Generator,
    size: int,
    band: tuple[int, int],
    *,
    falloff: float = 1.0,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Field:
    """Random field of mean 0 and variance 1.

    Args:
        rng: The same draws are made for every ``size``, so a finer picture shows the same field.
        size: Pixels along an edge.
        band: Lowest and highest frequency, in cycles across the square.
        falloff: Amplitude goes with frequency to minus this power.
        stretch: Streaks that are this much longer along u and v.
    """
    low, high = band
    coefficients = rng.standard_normal((2 * high + 1, high + 1, 2)) @ [1, 1j]
    fv, fu = np.meshgrid(np.arange(-high, high + 1), np.arange(high + 1), indexing="ij")
    frequency = np.hypot(fu * stretch[0], fv * stretch[1])
    inside = (frequency >= low) & (frequency <= high) & (np.maximum(np.abs(fu), np.abs(fv)) < size // 2)
    spectrum = np.zeros((size, size // 2 + 1), dtype=np.complex128)
    spectrum[fv[inside], fu[inside]] = coefficients[inside] * frequency[inside] ** -falloff
    field = np.fft.irfft2(spectrum, s=(size, size))
    return field / max(field.std(), 1e-12)


@dataclass(frozen=True, kw_only=True)
class Cells:
    """A division of the square: the number of the cell at each pixel and the way to its edge."""

    index: NDArray[np.intp]
    edge: Field
    """Distance to the nearest edge, in units of the square."""
    count: int

    def per_cell(self, values: Values) -> Values:
        """One value (or colour) of ``values`` for all pixels of a cell."""
        return cast(Values, values[self.index])


def bond(u: Field, v: Field, rows: int, columns: int, shifts: Field) -> Cells:
    """Rows of equal blocks; row i is moved by ``shifts[i]`` of a block."""
    row = np.floor(v * rows).astype(np.intp) % rows
    x, y = u * columns + shifts[row], v * rows
    column = np.floor(x).astype(np.intp) % columns
    edge_u = np.abs(x - np.round(x)) / columns
    edge_v = np.abs(y - np.round(y)) / rows
    return Cells(index=row * columns + column, edge=np.minimum(edge_u, edge_v), count=rows * columns)


def stones(rng: np.random.Generator, u: Field, v: Field, across: int) -> Cells:
    """Irregular cells, about ``across`` of them along an edge (Voronoi cells of a jittered grid)."""
    corner = np.stack(np.meshgrid(np.arange(across), np.arange(across)), axis=-1).reshape(-1, 2)
    points = (corner + rng.uniform(0.05, 0.95, corner.shape)) / across
    # Periodic in both directions, so that cells go on across the borders of the square.
    distance, index = KDTree(points, boxsize=1.0).query(np.stack([u, v], axis=-1), k=2)
    index, distance = np.asarray(index), np.asarray(distance)
    return Cells(index=index[..., 0], edge=(distance[..., 1] - distance[..., 0]) / 2, count=len(points))
