"""Pictures of the probe: errors by caption, scores of features, attention to words. ``data:`` addresses."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pretrain.figures import ACCENT, INK, LINE, SERIES, SOFT, WARM, svg_address, tidy_axes
from pretrain.pictures import hide_pixels
from pretrain.probing.attention import WordAttention, cells_inside
from pretrain.probing.compare import Comparison, Group
from pretrain.probing.scores import FeatureScore
from pretrain.probing.wording import REGION_TITLES, TITLES
from pretrain.statistics import Interval


def region_figure(regions: Mapping[str, Mapping[str, Comparison]]) -> str:
    """Error with every caption, one plot for each region, with intervals."""
    figure = Figure(figsize=(3.1 * len(regions) + 1.6, 2.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(regions), sharey=True))
    for ax, (region, captions) in zip(axes, regions.items(), strict=True):
        for y, held in enumerate(captions.values()):
            _draw_interval(ax, float(y), held.error_m, SERIES[1] if held.more_m else ACCENT)
        ax.set_yticks(range(len(captions)), [TITLES[n] for n in captions])
        ax.axvline(captions["right"].error_m.mean, color=ACCENT, linewidth=0.8, linestyle=":")
        tidy_axes(ax, REGION_TITLES[region])
        ax.set_xlabel("mean absolute depth error, m", fontsize=8, color=SOFT)
    axes[0].invert_yaxis()
    return svg_address(figure)


def distance_figure(groups: Sequence[Group], captions: Sequence[str]) -> str:
    """How much more error than with the right caption, by distance of the hidden object."""
    figure = Figure(figsize=(6.4, 2.6), layout="constrained")
    ax = figure.subplots()
    for number, name in enumerate(captions):
        x = [i + 0.08 * (number - len(captions) / 2) for i, g in enumerate(groups) if name in g.captions]
        more = [g.captions[name].more_m for g in groups if name in g.captions]
        means = np.array([m.mean for m in more if m])
        ends = np.array([(m.mean - m.low, m.high - m.mean) for m in more if m]).reshape(-1, 2).T
        ax.errorbar(
            x,
            means,
            yerr=ends,
            fmt="o-",
            markersize=3.5,
            linewidth=1.0,
            color=SERIES[number],
            label=TITLES[name],
        )
    ax.axhline(0, color=ACCENT, linewidth=0.8, linestyle=":")
    ax.set_xticks(range(len(groups)), [f"{g.name}\n{g.num_frames} frames" for g in groups])
    tidy_axes(ax, "error inside the object minus that with the right caption, m")
    ax.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return svg_address(figure)


def _draw_interval(ax: Axes, y: float, interval: Interval, color: str, *, is_hollow: bool = False) -> None:
    ax.plot([interval.low, interval.high], [y, y], color=color, linewidth=1.4)
    face = "white" if is_hollow else color
    ax.plot(interval.mean, y, "o", color=color, markersize=4.5, markerfacecolor=face)


def score_figure(scores: Sequence[FeatureScore]) -> str:
    """Scores of every encoder's features, one plot for each task; filled: linear, hollow: neighbours."""
    tasks = list(dict.fromkeys(s.task for s in scores))
    names = list(dict.fromkeys(f"{s.encoder}: {s.features}" for s in scores))
    columns = min(2, len(tasks))
    rows = -(-len(tasks) // columns)
    figure = Figure(figsize=(4.6 * columns, (0.24 * len(names) + 0.9) * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    for ax in axes[len(tasks) :]:
        ax.set_axis_off()
    for ax, task in zip(axes, tasks, strict=False):
        held = [s for s in scores if s.task == task]
        for score in held:
            y = names.index(f"{score.encoder}: {score.features}")
            is_neighbors = score.reader != "linear"
            color = WARM if is_neighbors else ACCENT
            interval = Interval(score.value, score.low, score.high)
            _draw_interval(ax, y + (0.18 if is_neighbors else -0.18), interval, color, is_hollow=is_neighbors)
        ax.axvline(held[0].chance, color=SOFT, linewidth=0.8, linestyle=":")
        ax.set_yticks(range(len(names)), names)
        tidy_axes(ax, f"{task} ({held[0].score})")
    axes[0].invert_yaxis()
    return svg_address(figure)


def attention_figure(
    rgb: UInt8[np.ndarray, "H W 3"],
    is_hidden: Bool[np.ndarray, "H W"],
    words: Sequence[str],
    attention: WordAttention,
) -> str:
    """How much each cell of the image looks at each word, a row for each layer; bars for CLS on the right.

    Args:
        rgb: The frame.
        is_hidden: What of it is behind a box.
        words: Of all language tokens; empty where there is none.
        attention: To these.
    """
    kept = [i for i, word in enumerate(words) if word]
    num_layers = len(attention.cells)
    figure = Figure(figsize=(0.85 * (len(kept) + 1) + 2.2, 0.95 * num_layers + 0.3), layout="constrained")
    axes = figure.subplots(
        num_layers, len(kept) + 2, width_ratios=[1] * (len(kept) + 1) + [2.4], squeeze=False
    )
    box = np.argwhere(cells_inside(is_hidden, attention.cells.shape[1:3]))
    for layer, row in enumerate(axes):
        top = float(attention.cells[layer][..., kept].max())
        row[0].imshow(hide_pixels(rgb, is_hidden))
        row[0].set_ylabel(f"layer {layer + 1}", fontsize=7, color=SOFT)
        for ax, i in zip(row[1:-1], kept, strict=True):
            ax.imshow(attention.cells[layer, ..., i], vmin=0, vmax=top, cmap="magma")
            if len(box):
                (top_row, left), (height, width) = box.min(axis=0), np.ptp(box, axis=0) + 1
                corner = (left - 0.5, top_row - 0.5)
                ax.add_patch(Rectangle(corner, width, height, fill=False, edgecolor="white", linewidth=0.8))
            if layer == 0:
                ax.set_title(words[i], fontsize=7, color=INK)
        for ax in row[:-1]:
            ax.set(xticks=[], yticks=[])
        labels = [words[i] if layer == num_layers - 1 else "" for i in kept]
        _draw_bars(row[-1], labels, attention.cls[layer, kept])
    axes[0, 0].set_title("masked", fontsize=7, color=INK)
    axes[0, -1].set_title("CLS", fontsize=7, color=INK)
    return svg_address(figure)


def _draw_bars(ax: Axes, labels: Sequence[str], values: Float[np.ndarray, " L"]) -> None:
    ax.bar(range(len(labels)), values, color=ACCENT)
    ax.set_xticks(range(len(labels)), labels, rotation=90)
    ax.tick_params(labelsize=5, colors=SOFT, length=2)
    ax.grid(color=LINE, linewidth=0.4, axis="y")
