"""What the autoencoder is told of a hidden object: the truth, nothing, something else, or a lie.

Owns the captions of the probe. A lie is about one slot and keeps template, rule and the two other slots of
the true caption.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from langwm_data.labels.captions import DIRECTIONS, TEMPLATES, DistanceFormat, make_caption
from pretrain.frames import FrameObject

RIGHT, EMPTY, OTHER = "right", "empty", "other"
DISTANCE, DIRECTION, CATEGORY = "distance", "direction", "category"
CONTRADICTIONS = (DISTANCE, DIRECTION, CATEGORY)
"""By the slot that they contradict."""
CAPTIONS = (RIGHT, EMPTY, OTHER, *CONTRADICTIONS)

MIN_OTHER_M = 1.0
"""Another object's caption is of another category and of a distance that differs by at least this much."""
SHIFT_M = 3.0
"""By how much the distance is contradicted: near objects are said to be so much farther, others nearer."""
NEAREST_SAID_M = 0.4
"""Said as half a metre; so a distance is contradicted by at least SHIFT_M - 0.5 m, rounding included."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One sentence about a hidden object."""

    text: str
    distance_m: float
    """That it was made from; not a number where it tells of none."""


NOTHING = Claim(text="", distance_m=float("nan"))

Claims = Mapping[str, Claim]
"""By the name of the caption; those in which an object cannot be spoken of are left out."""


def make_claims(
    rng: np.random.Generator,
    shown: FrameObject,
    donors: Sequence[FrameObject],
    width: int,
    distance_format: DistanceFormat,
) -> Claims:
    """The captions of ``CAPTIONS`` for one object, as far as they can be made.

    Args:
        rng: Draws template, rule, and what is named in the place of the object.
        shown: The object.
        donors: Those of other frames, whose captions and nouns may be used.
        width: Of the image, pixels.
        distance_format: How metres are said.
    """
    template, rule = int(rng.integers(1, len(TEMPLATES) + 1)), int(rng.integers(1, len(DIRECTIONS) + 1))

    def tell(of: FrameObject) -> Claim:
        distance_m = max(of.distance_m, 1e-3)
        caption = make_caption(
            of.noun,
            of.center_x,
            width,
            distance_m,
            template=template,
            rule=rule,
            distance_format=distance_format,
        )
        return Claim(text=caption.text, distance_m=distance_m)

    others = [o for o in donors if o.category != shown.category and o.noun != shown.noun]
    distant = [o for o in others if abs(o.distance_m - shown.distance_m) >= MIN_OTHER_M]
    claims = {RIGHT: tell(shown), EMPTY: NOTHING}
    if distant:
        claims[OTHER] = tell(distant[rng.integers(len(distant))])
    claims[DISTANCE] = tell(dataclasses.replace(shown, distance_m=contradict_distance(shown.distance_m)))
    mirrored = tell(dataclasses.replace(shown, center_x=width - shown.center_x))
    if mirrored.text != claims[RIGHT].text:  # what lies in front does so in a mirror too
        claims[DIRECTION] = mirrored
    if others:
        noun = others[rng.integers(len(others))].noun
        claims[CATEGORY] = tell(dataclasses.replace(shown, phrase=noun))
    return claims


def contradict_distance(distance_m: float) -> float:
    """Far for what is near, near for what is far, metres."""
    return distance_m + SHIFT_M if distance_m < SHIFT_M else max(distance_m - SHIFT_M, NEAREST_SAID_M)
