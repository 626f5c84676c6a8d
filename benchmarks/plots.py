"""What figures of several benchmarks have in common."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes


def plot_running_mean(
    axes: Axes,
    points: list[tuple[float, float]],
    *,
    window: int,
    **style: Any,
) -> None:
    """Draw means of the last ``window`` values, or of all where there are fewer, at the last one's step."""
    steps, values = np.array(points, float).T
    width = min(window, len(values))
    axes.plot(steps[width - 1 :], np.convolve(values, np.ones(width) / width, mode="valid"), **style)
