"""Which objects of a frame are hidden behind boxes, and what is said about them.

Owns the first row of Eq. 3. Hidden pixels are only marked here; the network fills them with the
ImageNet mean, so colour changes before and depth targets after are untouched.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.labels.captions import sample_caption
from pretrain.config import ObjectMaskConfig
from pretrain.frames import FrameObject


@dataclass(frozen=True, kw_only=True)
class HiddenObjects:
    """What was hidden in one frame."""

    is_hidden: NDArray[np.bool_]
    """(H, W)."""
    objects: tuple[FrameObject, ...]
    caption: str
    """One sentence for each object that is told of, in random order; may be empty."""


def hide_objects(
    rng: np.random.Generator,
    objects: Sequence[FrameObject],
    size: tuple[int, int],
    config: ObjectMaskConfig,
) -> HiddenObjects:
    """Hide randomly chosen objects and describe them.

    Args:
        rng: Source of every choice.
        objects: Those that may be hidden.
        size: Height and width of the frame.
        config: Limits and probabilities.

    Source: Eq. 3 (row 1), Sec. 3.1.1; several sentences joined in random order (decision 10).
    """
    is_hidden = np.zeros(size, dtype=np.bool_)
    chosen: list[FrameObject] = []
    num_offered = 0 if rng.random() < config.box_dropout else len(objects)
    for number in rng.permutation(num_offered):
        if len(chosen) == config.max_objects or is_hidden.mean() >= config.max_area:
            break
        chosen.append(objects[number])
        x1, y1, x2, y2 = box_with_margin(rng, objects[number], size, config.margin_px)
        is_hidden[y1:y2, x1:x2] = config.hides
    told = _told(objects, chosen, config)
    sentences = [] if rng.random() < config.caption_dropout else _describe(rng, told, size[1], config)
    hidden = tuple(chosen) if config.hides else ()
    return HiddenObjects(is_hidden=is_hidden, objects=hidden, caption=" ".join(sentences))


def _told(
    objects: Sequence[FrameObject], chosen: Sequence[FrameObject], config: ObjectMaskConfig
) -> Sequence[FrameObject]:
    """The objects that sentences are about."""
    if config.captions == "none":
        return ()
    if config.captions == "chosen":
        return chosen
    return sorted(objects, key=_box_area, reverse=True)[: config.max_objects]


def _box_area(obj: FrameObject) -> float:
    x1, y1, x2, y2 = obj.bbox_xyxy
    return (x2 - x1) * (y2 - y1)


def box_with_margin(
    rng: np.random.Generator, obj: FrameObject, size: tuple[int, int], margin_px: int
) -> tuple[int, int, int, int]:
    """The smallest whole-pixel box around ``obj``, each side moved outwards at random, inside the frame."""
    height, width = size
    x1, y1, x2, y2 = obj.bbox_xyxy
    left, top, right, bottom = rng.integers(0, margin_px + 1, size=4).tolist()
    return (
        max(int(np.floor(x1)) - left, 0),
        max(int(np.floor(y1)) - top, 0),
        min(int(np.ceil(x2)) + right, width),
        min(int(np.ceil(y2)) + bottom, height),
    )


def _describe(
    rng: np.random.Generator, objects: Sequence[FrameObject], width: int, config: ObjectMaskConfig
) -> list[str]:
    captions = [
        sample_caption(rng, o.noun, o.center_x, width, o.distance_m, distance_format=config.distance_format)
        for o in objects
    ]
    return [captions[number].text for number in rng.permutation(len(captions))]
