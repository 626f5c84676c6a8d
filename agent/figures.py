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

DASHES = ("-", "--", ":")
LEGEND_COLUMNS = 4
FLOOR, WALL, FURNITURE = "#f5f7fa", "#3b4350", "#c9d2de"


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One line of a plot."""

    name: str
    steps: Sequence[int]
    values: Sequence[float]


@dataclass(frozen=True, kw_only=True)
class Band:
    """A line between two others; not a number where nothing is known."""

    name: str
    steps: Float[np.ndarray, " B"]
    middle: Float[np.ndarray, " B"]
    low: Float[np.ndarray, " B"]
    high: Float[np.ndarray, " B"]


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


def band_figure(panels: Mapping[str, Sequence[Band]], x_label: str) -> str:
    """Plots side by side with one legend below, the same bands in each; returns an SVG ``data:`` address.

    Colours repeat with another dash when there are more bands than colours; the first is drawn on top.
    """
    num_bands = max((len(bands) for bands in panels.values()), default=0)
    legend_rows = -(-num_bands // LEGEND_COLUMNS)
    figure = Figure(figsize=(3.4 * len(panels), 2.6 + 0.2 * legend_rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(panels))).ravel()
    for ax, (title, bands) in zip(axes, panels.items(), strict=True):
        for index, band in reversed(list(enumerate(bands))):
            color, dash = SERIES[index % len(SERIES)], DASHES[index // len(SERIES) % len(DASHES)]
            width = 2.0 if index == 0 else 1.2
            ax.fill_between(band.steps, band.low, band.high, color=color, alpha=0.1, linewidth=0)
            ax.plot(band.steps, band.middle, dash, color=color, linewidth=width, marker=".", label=band.name)
        tidy_axes(ax, title)
        ax.set_xlabel(x_label, fontsize=8, color=SOFT)
    if num_bands:
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(
            handles[::-1],
            labels[::-1],
            loc="outside lower center",
            ncols=LEGEND_COLUMNS,
            fontsize=7,
            frameon=False,
        )
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
