"""From an instance mask and depth to one label per visible instance.

Owns what is measured of an object in an image and which objects are worth a caption. The same
function labels the rendered dataset and the frames that an agent sees while it trains.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
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
    reached = np.minimum(depth, config.max_depth_m)
    labels = []
    for number in _visible(instance):
        label = _measure(instance, reached, number, table[number])
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


def _visible(instance: NDArray[np.uint16]) -> list[int]:
    """Ids in the mask, ascending, without the background."""
    is_seen = np.zeros(int(instance.max()) + 1, bool)
    is_seen[instance] = True
    is_seen[0] = False
    return np.flatnonzero(is_seen).tolist()


def _measure(
    instance: NDArray[np.uint16], depth: NDArray[np.float32], number: int, name: InstanceName
) -> ObjectLabel:
    """The label of one instance, without captions; ``depth`` is clipped."""
    mask = cv2.inRange(instance, number, number)  # pyright: ignore[reportCallIssue, reportArgumentType]
    x, y, width, height = cv2.boundingRect(mask)
    inside = slice(y, y + height), slice(x, x + width)
    mask, depth = mask[inside], depth[inside]
    moments = cv2.moments(mask, binaryImage=True)
    area = moments["m00"]
    center_x, center_y = x + moments["m10"] / area + 0.5, y + moments["m01"] / area + 0.5
    mask[depth <= 0] = 0
    return ObjectLabel(
        instance=number,
        category=name.category,
        model=name.model,
        phrase=name.phrase,
        bbox_xyxy=(float(x), float(y), float(x + width), float(y + height)),
        center_px=(center_x, center_y),
        area_px=int(area),
        distance_m=cv2.mean(depth, mask)[0],
        direction_rule1=direction(center_x, instance.shape[1], 1),
        direction_rule2=direction(center_x, instance.shape[1], 2),
        captions=(),
    )
