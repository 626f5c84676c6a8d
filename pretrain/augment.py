"""Changes to a frame before its objects are hidden: spatial jitter, colour, grayscale, blur.

Works on one frame at a time in 8 bits, with OpenCV. Objects move with the pixels they describe.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pretrain.config import AugmentConfig
from pretrain.frames import FrameObject

RGB = NDArray[np.uint8]
Depth = NDArray[np.float32]


def augment_frame(
    rng: np.random.Generator,
    rgb: RGB,
    depth: Depth,
    objects: Sequence[FrameObject],
    config: AugmentConfig,
) -> tuple[RGB, Depth, list[FrameObject]]:
    """Everything in the paper's order: spatial jitter, then what changes colours only.

    Source: Sec. 3.1.1, Table 2; probabilities from BYOL.
    """
    rgb, depth, moved = spatial_jitter(rng, rgb, depth, objects, config.padding_px)
    if rng.random() < config.color_probability:
        rgb = color_jitter(rng, rgb, config)
    if rng.random() < config.grayscale_probability:
        rgb = adjust_saturation(rgb, 0.0)
    if rng.random() < config.blur_probability:
        rgb = cv2.GaussianBlur(rgb, (0, 0), rng.uniform(*config.blur_sigma_px))  # pyright: ignore[reportAssignmentType]
    return rgb, depth, moved


def spatial_jitter(
    rng: np.random.Generator,
    rgb: RGB,
    depth: Depth,
    objects: Sequence[FrameObject],
    padding_px: int,
) -> tuple[RGB, Depth, list[FrameObject]]:
    """Pad every side and crop back to the old size at a random place.

    New pixels repeat the edge in colour and are invalid (0) in depth. Objects that leave the frame
    are dropped; the others keep their distance.
    """
    x, y = rng.integers(0, 2 * padding_px + 1, size=2).tolist()
    height, width = depth.shape
    p = padding_px
    padded = cv2.copyMakeBorder(rgb, p, p, p, p, cv2.BORDER_REPLICATE)
    padded_depth = cv2.copyMakeBorder(depth, p, p, p, p, cv2.BORDER_CONSTANT, value=0.0)  # pyright: ignore[reportCallIssue, reportArgumentType]
    moved = [_shift(o, padding_px - x, padding_px - y, height, width) for o in objects]
    return (
        np.ascontiguousarray(padded[y : y + height, x : x + width], dtype=np.uint8),
        np.ascontiguousarray(padded_depth[y : y + height, x : x + width], dtype=np.float32),
        [o for o in moved if o is not None],
    )


def _shift(obj: FrameObject, dx: int, dy: int, height: int, width: int) -> FrameObject | None:
    x1, y1, x2, y2 = obj.bbox_xyxy
    x1, x2 = (min(max(x + dx, 0.0), float(width)) for x in (x1, x2))
    y1, y2 = (min(max(y + dy, 0.0), float(height)) for y in (y1, y2))
    if x2 <= x1 or y2 <= y1:
        return None
    center_x = min(max(obj.center_x + dx, x1), x2)
    return replace(obj, bbox_xyxy=(x1, y1, x2, y2), center_x=center_x)


def color_jitter(rng: np.random.Generator, rgb: RGB, config: AugmentConfig) -> RGB:
    """Brightness, contrast, saturation and hue by random amounts, in random order."""

    def factor(delta: float) -> float:
        return rng.uniform(1 - delta, 1 + delta)

    changes: list[Callable[[RGB], RGB]] = [
        lambda x: adjust_brightness(x, factor(config.brightness)),
        lambda x: adjust_contrast(x, factor(config.contrast)),
        lambda x: adjust_saturation(x, factor(config.saturation)),
        lambda x: adjust_hue(x, rng.uniform(-config.hue, config.hue)),
    ]
    for number in rng.permutation(len(changes)):
        rgb = changes[number](rgb)
    return rgb


def adjust_brightness(rgb: RGB, factor: float) -> RGB:
    """Blend with black: 0 gives black, 1 the image."""
    return _apply_line(rgb, factor, 0.0)


def adjust_contrast(rgb: RGB, factor: float) -> RGB:
    """Blend with the image's mean gray: 0 gives that gray, 1 the image."""
    gray = round(float(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).mean()))
    return _apply_line(rgb, factor, (1 - factor) * gray)


def adjust_saturation(rgb: RGB, factor: float) -> RGB:
    """Blend with the gray image: 0 gives gray, 1 the image."""
    gray = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.addWeighted(rgb, factor, gray, 1 - factor, 0.0), dtype=np.uint8)


def adjust_hue(rgb: RGB, shift: float) -> RGB:
    """Turn the colour circle by ``shift`` of its circumference."""
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)
    hsv[..., 0] += np.uint8(round(shift * 256) % 256)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB_FULL), dtype=np.uint8)


def _apply_line(rgb: RGB, slope: float, offset: float) -> RGB:
    table = np.clip(np.arange(256) * slope + offset, 0, 255).round().astype(np.uint8)
    return np.asarray(cv2.LUT(rgb, table), dtype=np.uint8)
