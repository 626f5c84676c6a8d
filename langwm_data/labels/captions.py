"""Template sentences about one object: which direction it lies in, how far away it is.

Owns the two direction rules, the seven templates and how a distance is said. Knows nothing of
images; where an object is and how far comes from ``labels.instances``.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

DistanceFormat = Literal["integer", "decimal"]

TEMPLATES: tuple[str, ...] = (
    "There is {object} in the {direction} {distance}.",
    "A {object} is situated in the {distance} of the {direction}.",
    "The {object} is approximately {distance}, {direction} from here.",
    "The {object} is approximately {distance}, to the {direction}.",
    "In the {direction}, {object} is {distance} to me.",
    "In the image, I can see {object}, and it is {distance} {direction}.",
    "If you look {distance} in the {direction}, you will see {object}.",
)
"""Template n of the paper stands at n - 1. Source: appendix, Language Templates."""

DIRECTIONS: dict[int, tuple[str, ...]] = {
    1: ("left", "front", "right"),
    2: ("outer left", "left", "front", "right", "outer right"),
}
"""What each direction rule can answer, from the image's left edge to its right."""

_BLOCK_ENDS: dict[int, tuple[int, ...]] = {1: (1, 3, 4), 2: (1, 2, 3, 4, 5)}
"""Where each answer ends, in blocks: rule 1 has four blocks, of which two are the front."""


@dataclass(frozen=True, kw_only=True)
class Caption:
    """One template sentence with the slots it was filled from."""

    text: str
    template: int
    """1 to 7. Source: appendix, Language Templates."""
    rule: int
    """1 or 2, the direction rule."""
    direction: str
    distance: str


def direction(center_x: float, width: float, rule: int) -> str:
    """Name the part of the image that an object's centre lies in.

    A centre exactly on the line between two parts belongs to the one on its left.

    Args:
        center_x: Horizontal centre in pixels from the left edge.
        width: Width of the image in pixels.
        rule: 1 divides it 1:2:1, 2 into fifths.

    Source: appendix, Language Templates.
    """
    assert rule in DIRECTIONS, rule
    ends = _BLOCK_ENDS[rule]
    block_size = width / ends[-1]
    for end, name in zip(ends[:-1], DIRECTIONS[rule][:-1], strict=True):
        if center_x <= end * block_size:
            return name
    return DIRECTIONS[rule][-1]


def format_distance(distance_m: float, fmt: DistanceFormat) -> str:
    """Say a distance in words that fit every template.

    ``integer`` rounds to whole metres, halves up ("1 meter", "3 meters"); what would become zero is
    "half a meter". ``decimal`` gives one decimal and at least "0.1 meters".

    Source: ours (method notes, decision 11); the paper leaves the format open.
    """
    assert distance_m > 0, distance_m
    if fmt == "decimal":
        return f"{max(distance_m, 0.1):.1f} meters"
    meters = math.floor(distance_m + 0.5)
    if meters == 0:
        return "half a meter"
    return "1 meter" if meters == 1 else f"{meters} meters"


def make_caption(  # noqa: PLR0913
    noun: str,
    center_x: float,
    width: float,
    distance_m: float,
    *,
    template: int,
    rule: int,
    distance_format: DistanceFormat,
) -> Caption:
    """Fill one template.

    Args:
        noun: What the object is called, such as ``dining table``; see ``SceneSpec.instances``.
        center_x: Horizontal centre of the object in pixels.
        width: Width of the image in pixels.
        distance_m: Mean depth of the object.
        template: 1 to 7, as the paper counts them.
        rule: 1 or 2, the direction rule.
        distance_format: Whole metres or one decimal.
    """
    assert 1 <= template <= len(TEMPLATES), template
    where = direction(center_x, width, rule)
    distance = format_distance(distance_m, distance_format)
    text = TEMPLATES[template - 1].format(object=noun, direction=where, distance=distance)
    return Caption(text=text, template=template, rule=rule, direction=where, distance=distance)


def sample_caption(
    rng: np.random.Generator,
    noun: str,
    center_x: float,
    width: float,
    distance_m: float,
    *,
    distance_format: DistanceFormat,
) -> Caption:
    """Fill a template and apply a direction rule, each drawn uniformly."""
    return make_caption(
        noun,
        center_x,
        width,
        distance_m,
        template=int(rng.integers(1, len(TEMPLATES) + 1)),
        rule=int(rng.integers(1, len(DIRECTIONS) + 1)),
        distance_format=distance_format,
    )
