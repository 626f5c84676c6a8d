"""Panels that show what the autoencoder saw, predicted and should have predicted."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pretrain.batch import MAEBatch
from pretrain.mae import IMAGENET_MEAN, IMAGENET_STD

RGB = NDArray[np.uint8]

_GAP = 4
_HEADER = 18
_WHITE = 255
_COLORMAP = cv2.COLORMAP_TURBO


def depth_to_rgb(depth_m: NDArray[np.float32], max_depth_m: float) -> RGB:
    """Near is warm, far is cool; invalid (0) is black."""
    near = 255 - np.clip(depth_m / max_depth_m * 255, 0, 255).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(near, _COLORMAP), cv2.COLOR_BGR2RGB)
    colors[depth_m == 0] = 0
    return np.asarray(colors, dtype=np.uint8)


def hide_pixels(rgb: RGB, is_hidden: NDArray[np.bool_]) -> RGB:
    """The frame as the network gets it."""
    shown = rgb.copy()
    shown[is_hidden] = np.round(np.array(IMAGENET_MEAN) * 255).astype(np.uint8)
    return shown


def make_panel(titles: Sequence[str], rows: Sequence[Sequence[RGB]], captions: Sequence[str]) -> RGB:
    """Images in rows under column titles, each row with its caption below it."""
    column = rows[0][0].shape[1] + _GAP
    header = np.hstack([_label(title, column) for title in titles])
    lines = [header]
    for images, caption in zip(rows, captions, strict=True):
        padded = [
            cv2.copyMakeBorder(i, 0, 0, 0, _GAP, cv2.BORDER_CONSTANT, value=(_WHITE,) * 3) for i in images
        ]
        lines += [np.hstack(padded), _label(caption or "(no caption)", header.shape[1])]
    return np.vstack(lines).astype(np.uint8)


def colors_to_rgb(image: NDArray[np.float32]) -> RGB:
    """Colours (3, H, W) in ImageNet's units as a picture."""
    mean, std = np.array(IMAGENET_MEAN), np.array(IMAGENET_STD)
    return np.clip((image.transpose(1, 2, 0) * std + mean) * 255, 0, 255).round().astype(np.uint8)


def mae_panel(batch: MAEBatch, predicted: NDArray[np.float32], max_depth_m: float, count: int = 4) -> RGB:
    """Input, masked input, prediction and truth of the first ``count`` frames of a batch.

    Args:
        batch: On the CPU.
        predicted: (B, 1, H, W), depth in metres, or (B, 3, H, W), colours in ImageNet's units.
        max_depth_m: End of the colour scale.
        count: Rows at most.
    """
    is_depth = predicted.shape[1] == 1
    rows = []
    for i in range(min(count, len(batch))):
        rgb, is_hidden, truth = batch.rgb[i].numpy(), batch.is_hidden[i].numpy(), batch.depth[i].numpy()
        rows.append(
            [
                rgb,
                hide_pixels(rgb, is_hidden),
                depth_to_rgb(np.maximum(predicted[i, 0], 1e-3), max_depth_m)
                if is_depth
                else colors_to_rgb(predicted[i]),
                depth_to_rgb(truth, max_depth_m) if is_depth else rgb,
            ]
        )
    what = "depth" if is_depth else "colours"
    titles = ("input", "masked input", f"predicted {what}", f"true {what}")
    return make_panel(titles, rows, batch.captions[: len(rows)])


def _label(text: str, width: int) -> RGB:
    line = np.full((_HEADER, width, 3), _WHITE, dtype=np.uint8)
    cv2.putText(line, text, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 1, cv2.LINE_AA)
    return line
