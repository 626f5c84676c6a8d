"""Pictures for reports: learning curves and top-down trajectories, as self-contained image addresses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from pretrain.figures import ACCENT, SERIES, SOFT, WARM, svg_address, tidy_axes

FLOOR, WALL, FURNITURE = "#f5f7fa", "#3b4350", "#c9d2de"


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One line of a plot."""

    name: str
    steps: Sequence[int]
    values: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class Walk:
    """One episode on a floor plan."""

    positions: Float[np.ndarray, "T 2"]
    goal: tuple[float, float]
    is_success: bool


def curve_figure(panels: Mapping[str, Sequence[Curve]], x_label: str) -> str:
    """Small plots side by side, one for each title; returns an SVG ``data:`` address."""
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.4 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for ax, (title, curves) in zip(axes, panels.items(), strict=False):
        _draw_curves(ax, title, curves, x_label)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    return svg_address(figure)


def _draw_curves(ax: Axes, title: str, curves: Sequence[Curve], x_label: str) -> None:
    for curve, color in zip(curves, SERIES, strict=False):
        ax.plot(curve.steps, curve.values, color=color, linewidth=1.4, label=curve.name)
    tidy_axes(ax, title)
    ax.set_xlabel(x_label, fontsize=8, color=SOFT)
    if len(curves) > 1:
        ax.legend(fontsize=7, frameon=False)


def map_figure(plan: Sequence[tuple[str, Any]], walks: Sequence[Walk]) -> str:
    """Trajectories on a floor plan seen from above; returns an SVG ``data:`` address.

    Args:
        plan: What ``floor_plan`` returns: (kind, polygon in metres) in drawing order.
        walks: Episodes; a dot marks the start, a ring of 0.36 m the goal.
    """
    figure = Figure(figsize=(4.0, 3.4), layout="constrained")
    ax = figure.subplots()
    for kind, polygon in plan:
        color = {"floor": FLOOR, "wall": WALL}.get(kind, FURNITURE)
        ax.add_patch(Polygon(np.asarray(polygon), closed=True, facecolor=color, edgecolor="none"))
    for walk in walks:
        color = ACCENT if walk.is_success else WARM
        ax.plot(*walk.positions.T, color=color, linewidth=1.3)
        ax.plot(*walk.positions[0], "o", color=color, markersize=3)
        ax.add_patch(Circle(walk.goal, 0.36, facecolor="none", edgecolor=color, linewidth=1.0))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()
    return svg_address(figure)
