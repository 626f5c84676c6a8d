"""A page to look at a dataset with: histograms, and colour, instances, depth and captions of some frames."""

import base64
import colorsys
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import jinja2
import numpy as np
from numpy.typing import NDArray

from langwm_data import atomic
from langwm_data.png import image_address
from langwm_data.scenes.taxonomy import is_structure
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.plots import draw_plots
from langwm_data.shards.sample import Sample

_TEST_SHARE = 4
"""One frame in this many is of the test split, where there is one."""
_MASK_OPACITY = 0.55
_INVALID_RGB = (128, 128, 128)
_RAMP_STOPS = 16
_GOLDEN_RATIO = 0.618034
_LETTER_WIDTH = 0.58
"""Of a letter, as a fraction of the font size."""


def write_gallery(path: Path | str, out_html: Path, *, count: int = 24) -> None:
    """Write a self-contained HTML page of ``count`` frames spread evenly over a dataset.

    Raises:
        DatasetError: If there is no finished dataset at ``path``, or it is damaged.
    """
    dataset = ShardDataset(path)
    samples = [dataset[number] for number in spread(dataset, count)]
    depth_max_m = _round_depth(samples)
    manifest = dataset.manifest
    template = resources.files("langwm_data.shards") / "templates" / "gallery.html.j2"
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = environment.from_string(template.read_text("utf-8")).render(
        title="Frames of a LanGWM dataset",
        subtitle=f"{len(samples)} of {manifest.frames} frames, {manifest.captions} captions in all, "
        f"{manifest.camera.height} x {manifest.camera.width} px",
        note=f"{manifest.generator}, renderer {manifest.renderer}; key: floor, then number in its split",
        ramp=", ".join(_ramp()),
        plots=[_png_address(data) for data in draw_plots(dataset).values()],
        depth_max_m=depth_max_m,
        height=manifest.camera.height,
        width=manifest.camera.width,
        font_px=_font_px(manifest.camera.height),
        frames=[_describe(sample, depth_max_m) for sample in samples],
    )
    atomic.write_text(out_html, page)


def spread(dataset: ShardDataset, count: int) -> list[int]:
    """Numbers of the frames to show: evenly spaced in each split."""
    by_split = {
        name: np.flatnonzero(np.asarray(dataset.frames["split"].to_pylist()) == name)
        for name in dataset.manifest.splits
    }
    shares = dict.fromkeys(by_split, count)
    if len(by_split) > 1:
        shares["test"] = min(-(-count // _TEST_SHARE), len(by_split["test"]))
        shares["train"] = count - shares["test"]
    chosen: list[int] = []
    for name, numbers in by_split.items():
        num = min(shares[name], len(numbers))
        chosen += numbers[np.linspace(0, len(numbers) - 1, num).round().astype(int)].tolist()
    return chosen


def instance_color(instance: int) -> tuple[int, int, int]:
    """A colour for an instance id, far from those of its neighbours."""
    r, g, b = colorsys.hsv_to_rgb(instance * _GOLDEN_RATIO % 1.0, 0.75, 0.95)
    return round(255 * r), round(255 * g), round(255 * b)


def draw_instances(sample: Sample) -> NDArray[np.uint8]:
    """The colour image with every object (not walls, floor or ceiling) tinted in its own colour."""
    image = sample.rgb.astype(np.float32)
    for obj in sample.meta["objects"]:
        if not is_structure(obj["category"]):
            mask = sample.instance == obj["instance"]
            tint = np.array(instance_color(obj["instance"]), np.float32)
            image[mask] = (1 - _MASK_OPACITY) * image[mask] + _MASK_OPACITY * tint
    return np.rint(image).astype(np.uint8)


def draw_depth(depth: NDArray[np.float32], max_m: float) -> NDArray[np.uint8]:
    """Depth in colours from 0 to ``max_m``; invalid pixels are grey."""
    gray = np.rint(np.clip(depth / max_m, 0, 1) * 255).astype(np.uint8)
    image = cv2.applyColorMap(gray, cv2.COLORMAP_VIRIDIS)[..., ::-1].copy()
    image[depth == 0] = _INVALID_RGB
    return image.astype(np.uint8)


def _round_depth(samples: list[Sample]) -> int:
    """A depth in whole metres that nearly all pixels stay below."""
    return max(1, int(np.ceil(np.percentile(np.stack([sample.depth for sample in samples]), 99))))


def _describe(sample: Sample, depth_max_m: float) -> dict[str, Any]:
    height, width = sample.depth.shape
    named = sorted((o for o in sample.meta["objects"] if o["captions"]), key=lambda o: o["area_px"])
    objects = [_describe_object(obj, width) for obj in reversed(named)]
    _place_names(objects, height, _font_px(height))
    return {
        "key": sample.key,
        "split": sample.meta["split"],
        "rgb": image_address(sample.rgb),
        "masks": image_address(draw_instances(sample)),
        "depth": image_address(draw_depth(sample.depth, depth_max_m)),
        "depth_max": f"{sample.depth.max():.1f} m",
        "objects": sorted(objects, key=lambda obj: obj["x"]),
    }


def _describe_object(obj: dict[str, Any], width: int) -> dict[str, Any]:
    x1, y1, x2, y2 = obj["bbox_xyxy"]
    r, g, b = instance_color(obj["instance"])
    is_right = x1 > 0.6 * width
    return {
        "x": x1,
        "y": y1,
        "width": x2 - x1,
        "height": y2 - y1,
        "text_x": x2 - 1 if is_right else x1 + 1,
        "anchor": "end" if is_right else "start",
        "color": f"rgb({r},{g},{b})",
        "name": obj["phrase"],
        "caption": obj["captions"][0]["text"],
        "distance": f"{obj['distance_m']:.2f} m, {obj['direction_rule1']} / {obj['direction_rule2']}",
    }


def _place_names(objects: list[dict[str, Any]], height: int, font_px: float) -> None:
    """Give every name a line at the top of its box, lower where it would cover another name.

    Where there is no room left, the name is dropped; colour and caption still tell the object.
    """
    taken: list[tuple[float, float, float]] = []
    for obj in objects:
        length = _LETTER_WIDTH * font_px * len(obj["name"])
        left = obj["text_x"] - (length if obj["anchor"] == "end" else 0)
        baseline = obj["y"] + font_px
        while any(a < left + length and left < b and abs(y - baseline) < font_px for a, b, y in taken):
            baseline += font_px / 2
        if baseline > height:
            obj["name"], baseline = "", height
        else:
            taken.append((left, left + length, baseline))
        obj["text_y"] = baseline


def _png_address(data: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(data).decode()


def _font_px(height: int) -> float:
    return round(height / 20, 2)


def _ramp() -> list[str]:
    gray = np.linspace(0, 255, _RAMP_STOPS).round().astype(np.uint8)
    colors = cv2.applyColorMap(gray, cv2.COLORMAP_VIRIDIS).reshape(-1, 3)
    return [f"rgb({r},{g},{b})" for b, g, r in colors.tolist()]
