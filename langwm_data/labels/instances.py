"""From an instance mask and depth to one label per visible instance.

Owns what is measured of an object in an image and which objects are worth a caption. The same
function labels the rendered dataset and the frames that an agent sees while it trains.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import LabelsConfig
from langwm_data.labels.captions import Caption, direction, sample_caption
from langwm_data.scenes.spec import InstanceName
from langwm_data.scenes.taxonomy import is_nameable

__all__ = ["Caption", "ObjectLabel", "is_eligible", "label_frame"]


@dataclass(frozen=True, kw_only=True)
class ObjectLabel:
    """One visible instance. Pixels are edges: a box covers x1 <= x < x2 (exclusive), floats."""

    instance: int
    category: str
    model: str
    phrase: str
    """The noun for it."""
    bbox_xyxy: tuple[float, float, float, float]
    center_px: tuple[float, float]
    """Centroid of the mask, x and y; a pixel's centre lies at .5."""
    area_px: int
    distance_m: float
    """Mean z-depth over the mask's valid pixels, each clipped to ``LabelsConfig.max_depth_m`` first;
    0 where the mask has no valid depth."""
    direction_rule1: str
    direction_rule2: str
    captions: tuple[Caption, ...]
    """Empty for surfaces and for objects too small to be named."""


def is_eligible(label: ObjectLabel, image_area: int, config: LabelsConfig) -> bool:
    """Whether an object gets a caption: furniture, large enough, at a known distance.

    Source: ours (method notes, decision 13).
    """
    return (
        is_nameable(label.category)
        and label.area_px >= config.min_area_fraction * image_area
        and label.distance_m > 0
    )


def label_frame(
    instance: NDArray[np.uint16],
    depth: NDArray[np.float32],
    table: Mapping[int, InstanceName],
    config: LabelsConfig,
    rng: np.random.Generator,
) -> list[ObjectLabel]:
    """Label everything that is visible, sorted by instance id; eligible objects get one caption.

    Args:
        instance: (H, W), 0 = background.
        depth: (H, W), metres, 0 = invalid.
        table: What each instance is called, as ``SceneSpec.instances`` gives it.
        config: Which objects are captioned, and how.
        rng: Draws the templates and direction rules, in the order of the instance ids.
    """
    assert instance.shape == depth.shape, (instance.shape, depth.shape)
    width = instance.shape[1]
    labels = []
    for label in _measure(instance, np.minimum(depth, config.max_depth_m), table):
        if is_eligible(label, instance.size, config):
            caption = sample_caption(
                rng,
                label.phrase,
                label.center_px[0],
                width,
                label.distance_m,
                distance_format=config.distance_format,
            )
            label = dataclasses.replace(label, captions=(caption,))
        labels.append(label)
    return labels


def _measure(
    instance: NDArray[np.uint16], depth: NDArray[np.float32], table: Mapping[int, InstanceName]
) -> Iterator[ObjectLabel]:
    """Labels of all instances in the mask but the background, without captions; ``depth`` is clipped."""
    width = instance.shape[1]
    seen = {name: values.tolist() for name, values in _measure_runs(instance, depth).items()}
    for number, box, center, area_px, distance_m in zip(*seen.values(), strict=True):
        if number:
            name = table[number]
            yield ObjectLabel(
                instance=number,
                category=name.category,
                model=name.model,
                phrase=name.phrase,
                bbox_xyxy=tuple(box),
                center_px=tuple(center),
                area_px=area_px,
                distance_m=distance_m,
                direction_rule1=direction(center[0], width, 1),
                direction_rule2=direction(center[0], width, 2),
                captions=(),
            )


def _measure_runs(instance: NDArray[np.uint16], depth: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """Number, box, centre, area and mean valid depth of everything in the mask, by ascending number.

    The mask is taken apart into runs, equal pixels side by side in one row, which are far fewer.
    """
    width = instance.shape[1]
    is_start = np.ones(instance.shape, np.bool_)
    np.not_equal(instance[:, 1:], instance[:, :-1], out=is_start[:, 1:])
    start = np.flatnonzero(is_start)
    order = np.argsort(instance.ravel()[start], kind="stable")  # each instance's from top to bottom
    number, length = instance.ravel()[start][order], np.diff(start, append=instance.size)[order]
    y, x = np.divmod(start[order], width)
    first = np.flatnonzero(np.append(True, number[1:] != number[:-1]))
    last = np.append(first[1:], len(number)) - 1
    area = np.add.reduceat(length, first)
    middle = np.stack([length * (2 * x + length), length * (2 * y + 1)])
    box = [np.minimum.reduceat(x, first), y[first], np.maximum.reduceat(x + length, first), y[last] + 1]
    of_runs = [np.add.reduceat(values.ravel(), start, dtype=np.float64) for values in (depth, depth > 0)]
    distance, num_valid = np.add.reduceat(np.stack(of_runs)[:, order], first, axis=1)
    return {
        "number": number[first],
        "box": np.stack(box, axis=1).astype(np.float64),
        "center": (np.add.reduceat(middle, first, axis=1) / (2 * area)).T,
        "area": area,
        "distance": distance / np.maximum(num_valid, 1),
    }
