"""Histograms of a dataset: how far, how large, how hidden its objects are, and of which categories."""

from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from langwm_data import atomic
from langwm_data.scenes.taxonomy import is_structure, phrase
from langwm_data.shards.dataset import ShardDataset

_SIZE_IN = (5.6, 3.4)
_DPI = 110
_SPLIT_COLORS = {"train": "#4878a8", "val": "#8f9d4c", "test": "#d98545"}
_NUM_BINS = 20
_MOST_CATEGORIES = 20


def write_plots(path: Path | str, folder: Path) -> list[Path]:
    """Write every plot of the dataset at ``path`` as ``<name>.png`` into ``folder``.

    Raises:
        DatasetError: If there is no finished dataset at ``path``, or it is damaged.
    """
    plots = {folder / f"{name}.png": data for name, data in draw_plots(ShardDataset(path)).items()}
    for file, data in plots.items():
        atomic.write_bytes(file, data)
    return list(plots)


def draw_plots(dataset: ShardDataset) -> dict[str, bytes]:
    """PNG of each plot by name, of every visible object but walls, floors and ceilings."""
    tables = furniture_by_split(dataset)
    height, width = dataset.manifest.camera.height, dataset.manifest.camera.width
    plots: dict[str, Callable[[Axes], None]] = {
        "distances": lambda axes: _plot_distances(axes, tables),
        "areas": lambda axes: _plot_areas(axes, tables, height * width),
        "visible_fractions": lambda axes: _plot_visible_fractions(axes, tables),
        "categories": lambda axes: _plot_categories(axes, tables),
    }
    return {name: _png(plot) for name, plot in plots.items()}


def furniture_by_split(dataset: ShardDataset) -> dict[str, pa.Table]:
    """The rows of ``dataset.objects`` that are neither wall, floor nor ceiling."""
    structures = [name for name in dataset.manifest.categories if is_structure(name)]
    furniture = dataset.objects.filter(~pc.field("category").isin(structures))
    return {name: furniture.filter(pc.field("split") == name) for name in dataset.manifest.splits}


def _plot_distances(axes: Axes, tables: dict[str, pa.Table]) -> None:
    values = {name: table["distance_m"].to_numpy() for name, table in tables.items()}
    farthest = max((float(column.max()) for column in values.values() if len(column)), default=1.0)
    _stack(axes, values, np.linspace(0, np.ceil(farthest), _NUM_BINS + 1))
    axes.set(title="Distance of objects", xlabel="mean z-depth (m)", ylabel="objects")


def _plot_areas(axes: Axes, tables: dict[str, pa.Table], num_pixels: int) -> None:
    values = {name: table["area_px"].to_numpy() / num_pixels for name, table in tables.items()}
    _stack(axes, values, np.geomspace(1 / num_pixels, 1, _NUM_BINS + 1))
    axes.set(title="Area of objects", xlabel="visible share of the picture", ylabel="objects", xscale="log")
    axes.xaxis.set_major_formatter(lambda share, _: f"{100 * share:.3g}%")


def _plot_visible_fractions(axes: Axes, tables: dict[str, pa.Table]) -> None:
    values = {name: table["visible_fraction"].to_numpy() for name, table in tables.items()}
    _stack(axes, values, np.linspace(0, 1, _NUM_BINS + 1))
    axes.set(title="How much of objects is seen", xlabel="share of the silhouette", ylabel="objects")
    axes.xaxis.set_major_formatter(PercentFormatter(xmax=1))


def _plot_categories(axes: Axes, tables: dict[str, pa.Table]) -> None:
    """A bar for each of the most frequent categories, the first on top, divided by split."""
    counts = {split: Counter(table["category"].to_pylist()) for split, table in tables.items()}
    total = sum(counts.values(), Counter())
    names = sorted(total, key=lambda category: (-total[category], category))[:_MOST_CATEGORIES]
    left = np.zeros(len(names))
    for split, of_category in counts.items():
        widths = np.array([of_category[name] for name in names])
        axes.barh(
            [phrase(name) for name in names], widths, left=left, color=_SPLIT_COLORS[split], label=split
        )
        left += widths
    axes.invert_yaxis()
    axes.tick_params(axis="y", labelsize=7)
    axes.set(title=f"{len(names)} most frequent of {len(total)} categories", xlabel="objects seen")
    axes.legend(frameon=False, loc="lower right")


def _stack(axes: Axes, values: dict[str, np.ndarray], edges: np.ndarray) -> None:
    """One histogram whose bars are divided by split."""
    colors = [_SPLIT_COLORS[name] for name in values]
    axes.hist(list(values.values()), bins=edges.tolist(), stacked=True, color=colors, label=list(values))
    axes.legend(frameon=False)


def _png(plot: Callable[[Axes], None]) -> bytes:
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    plot(axes)
    data = BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()
