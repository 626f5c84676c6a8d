"""One frame as a person wants to see it: a picture of its images and captions, and a table of its objects."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from langwm_data import atomic
from langwm_data.scenes.taxonomy import is_structure, phrase
from langwm_data.shards.gallery import draw_depth, draw_instances, instance_color
from langwm_data.shards.sample import Sample

_PANEL_IN = 4.4
_LINE_IN = 0.24
_DPI = 110


def describe_frame(sample: Sample) -> str:
    """Where a frame was taken and a line for each of its objects, largest first."""
    meta, camera = sample.meta, sample.meta["camera"]
    x, y, z = (row[3] for row in camera["camera_to_world"][:3])
    lines = [
        f"{sample.key}: {meta['split']} split, floor {meta['scene']}, {len(meta['palette'])} materials",
        f"camera at ({x:.2f}, {y:.2f}, {z:.2f}) m, yaw {np.degrees(camera['yaw_rad']):.0f} deg,"
        f" pitch {np.degrees(camera['pitch_rad']):.0f} deg",
        "",
        f"{'id':>4}  {'category':<16}{'area px':>8}{'seen':>6}{'distance':>10}  captions",
    ]
    for obj in sorted(meta["objects"], key=lambda obj: -obj["area_px"]):
        captions = " | ".join(caption["text"] for caption in obj["captions"])
        lines.append(
            f"{obj['instance']:>4}  {phrase(obj['category']):<16}{obj['area_px']:>8}"
            f"{obj['visible_fraction']:>6.0%}{obj['distance_m']:>8.2f} m  {captions}".rstrip()
        )
    return "\n".join(lines)


def write_frame_picture(sample: Sample, out_png: Path) -> None:
    """Write colour, instances with their boxes and ids, depth, and the captions below, as one PNG."""
    height, width = sample.depth.shape
    furniture = [obj for obj in sample.meta["objects"] if not is_structure(obj["category"])]
    captions_in = _LINE_IN * (len(furniture) + 1)
    panel_in = _PANEL_IN * height / width + 0.3
    figure = Figure(figsize=(3 * _PANEL_IN, panel_in + captions_in), dpi=_DPI, layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=[panel_in, captions_in])
    color, instances, depth = (figure.add_subplot(grid[0, column]) for column in range(3))
    _show(color, sample.rgb, sample.key)
    _show(instances, draw_instances(sample), "instances")
    for obj in furniture:
        _draw_box(instances, obj)
    max_m = max(float(sample.depth.max()), 1.0)
    _show(depth, draw_depth(sample.depth, max_m), "depth (m); grey: invalid")
    figure.colorbar(ScalarMappable(Normalize(0, max_m), "viridis"), ax=depth, shrink=0.8)
    _write_captions(figure.add_subplot(grid[1, :]), furniture)
    data = BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    atomic.write_bytes(out_png, data.getvalue())


def _show(axes: Axes, image: np.ndarray, title: str) -> None:
    height, width = image.shape[:2]
    axes.imshow(image, interpolation="nearest", extent=(0, width, height, 0))
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()


def _draw_box(axes: Axes, obj: dict[str, Any]) -> None:
    x1, y1, x2, y2 = obj["bbox_xyxy"]
    color = _color(obj)
    axes.add_patch(Rectangle((x1, y1), x2 - x1, y2 - y1, fill=False, edgecolor=color, linewidth=1.2))
    box = {"facecolor": color, "edgecolor": "none", "pad": 1, "alpha": 0.85}
    axes.text(
        x1 + 1, y1 + 1, str(obj["instance"]), fontsize=7, color="black", va="top", bbox=box, clip_on=True
    )


def _write_captions(axes: Axes, objects: list[dict[str, Any]]) -> None:
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(len(objects) + 1, 0))
    for row, obj in enumerate(objects):
        axes.text(0.01, row + 0.5, "■", color=_color(obj), fontsize=11, va="center")
        said = " | ".join(caption["text"] for caption in obj["captions"]) or "no caption"
        line = f"{obj['instance']} {phrase(obj['category'])}: {said}"
        axes.text(0.03, row + 0.5, line, fontsize=9, va="center")


def _color(obj: dict[str, Any]) -> tuple[float, float, float]:
    r, g, b = instance_color(obj["instance"])
    return r / 255, g / 255, b / 255
