"""The one place that writes PNG: colour in RGB order, gray and ids as they are."""

import base64
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_PARAMS = (
    cv2.IMWRITE_PNG_COMPRESSION,
    2,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_DEFAULT,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_NONE,
)
"""Chosen by measurement on rendered rooms: 8 % more bytes than level 6 in half of its time."""


def encode_png(image: NDArray[Any]) -> bytes:
    """PNG bytes of (H, W, 3) uint8 in RGB order, or (H, W) uint8 or uint16. Same image, same bytes."""
    is_color = image.ndim == 3
    assert image.dtype == np.uint8 or (image.dtype == np.uint16 and not is_color), image.dtype
    assert not is_color or image.shape[2] == 3, image.shape
    is_written, data = cv2.imencode(
        ".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if is_color else image, _PARAMS
    )
    assert is_written
    return data.tobytes()


def image_address(image: NDArray[Any]) -> str:
    """The same as a ``data:`` address, for pages that hold their pictures."""
    return "data:image/png;base64," + base64.b64encode(encode_png(image)).decode()
