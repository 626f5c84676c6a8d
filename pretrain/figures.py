"""What pictures in reports have in common: colours, axes, and how they get into a page."""

import base64
import io

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, SOFT, LINE, ACCENT, WARM = "#1d2430", "#5c6675", "#d9dee6", "#1f6f8b", "#c8553d"
SERIES = (ACCENT, WARM, SOFT, "#7a9e4f", "#8a5aa3", "#d29a2c")
"""Colours of lines and points, in order."""


def tidy_axes(ax: Axes, title: str) -> None:
    """Quiet ticks and grid, a title on the left."""
    ax.set_title(title, fontsize=9, color=INK, loc="left")
    ax.tick_params(labelsize=7, colors=SOFT)
    ax.grid(color=LINE, linewidth=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def svg_address(figure: Figure) -> str:
    """A figure as a ``data:`` address. Same figure, same bytes."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "langwm"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()
