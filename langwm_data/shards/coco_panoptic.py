"""Panoptic segmentation in COCO's form: an image of segment ids and a table of segments.

Objects are things and keep their instance id. Walls, floors and ceilings are stuff: as COCO asks, all
of a category in one image are one segment, named by the lowest of their instance ids.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.taxonomy import is_structure


def panoptic_image(instance: NDArray[np.uint16], objects: Sequence[Mapping[str, Any]]) -> NDArray[np.uint8]:
    """Segment ids as colours, (H, W, 3): id = R + 256 G + 65536 B; black belongs to nothing.

    Source: the format page of cocodataset.org.
    """
    segment_of = np.zeros(int(instance.max()) + 1, np.uint16)
    for members in _segments(objects):
        segment_of[[obj["instance"] for obj in members]] = members[0]["instance"]
    segments = segment_of[instance]
    return np.stack([segments & 255, segments >> 8, np.zeros_like(segments)], axis=-1).astype(np.uint8)


def segments_info(
    objects: Sequence[Mapping[str, Any]], category_ids: Mapping[str, int]
) -> list[dict[str, Any]]:
    """One entry per segment of an image: id, category, area and box (x, y, width, height)."""
    return [
        {
            "id": members[0]["instance"],
            "category_id": category_ids[members[0]["category"]],
            "area": sum(obj["area_px"] for obj in members),
            "bbox": _bounding_box([obj["bbox_xyxy"] for obj in members]),
            "iscrowd": 0,
        }
        for members in _segments(objects)
    ]


def _segments(objects: Iterable[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """The objects that make up each segment, lowest instance first."""
    segments: dict[Any, list[Mapping[str, Any]]] = {}
    for obj in sorted(objects, key=lambda obj: obj["instance"]):
        name = obj["category"] if is_structure(obj["category"]) else obj["instance"]
        segments.setdefault(name, []).append(obj)
    return list(segments.values())


def _bounding_box(boxes: Sequence[Sequence[float]]) -> list[float]:
    x1, y1, x2, y2 = zip(*boxes, strict=True)
    return [min(x1), min(y1), max(x2) - min(x1), max(y2) - min(y1)]
