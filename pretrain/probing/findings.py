"""All comparisons of a probe of language, and what they say in sentences. Pure functions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from langwm_data.seeding import make_rng
from pretrain.probing.claims import CATEGORY, DIRECTION, DISTANCE, EMPTY, OTHER, RIGHT
from pretrain.probing.compare import (
    Comparison,
    Group,
    by_category,
    by_distance,
    by_model_split,
    compare,
    compare_group,
    heed_distance,
)
from pretrain.probing.grounding import OBJECT, REGIONS, GroundingResult
from pretrain.probing.wording import TITLES, change_text, range_text
from pretrain.statistics import Interval


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Everything that the tables show; groups are compared inside the hidden object."""

    about: str
    """Title of the frames."""
    num_frames: int
    regions: Mapping[str, Mapping[str, Comparison]]
    """By region, then by caption."""
    heeded: Interval
    """See ``heed_distance``."""
    by_distance: list[Group]
    by_category: list[Group]
    subsets: list[Group]
    """Of all sets of frames."""


@dataclass(frozen=True, kw_only=True)
class Grounding:
    """Numbers, and the measurement that most of them are about."""

    numbers: Numbers
    result: GroundingResult


def sum_up(
    measured: Mapping[str, GroundingResult], about: str, model_splits: Mapping[str, str], seed: int
) -> Grounding:
    """Compare captions in every way that the page shows.

    Args:
        measured: By title of the frames.
        about: The title that most tables are about.
        model_splits: Of each furniture model on record.
        seed: Of the intervals.
    """
    result = measured[about]
    rng = make_rng(seed, "intervals")
    numbers = Numbers(
        about=about,
        num_frames=len(result.scene),
        regions={region: compare(result.errors_in(region), rng) for region in REGIONS},
        heeded=heed_distance(result.scene.claims, result.depths, rng),
        by_distance=by_distance(result, rng),
        by_category=by_category(result, rng),
        subsets=[g for title in measured for g in _subsets(measured[title], title, model_splits, rng)],
    )
    return Grounding(numbers=numbers, result=result)


def _subsets(
    result: GroundingResult, title: str, model_splits: Mapping[str, str], rng: np.random.Generator
) -> list[Group]:
    everything = np.ones(len(result.scene), dtype=np.bool_)
    whole = compare_group(title, result.errors_in(OBJECT), everything, rng)
    return [g for g in (whole, *by_model_split(result, title, model_splits, rng)) if g is not None]


def findings(numbers: Numbers) -> list[str]:
    """What a reader should know first."""
    captions = numbers.regions[OBJECT]
    right, empty = captions[RIGHT].error_m, captions[EMPTY].more_m
    assert empty is not None
    share = 100 * empty.mean / (right.mean + empty.mean)
    verb = "takes off" if share >= 0 else "adds"
    lines = [
        f"Inside hidden objects the depth error is {right.mean:.2f} m with the right caption. An empty one"
        f" {change_text(empty)}: the right caption {verb} {abs(share):.0f} %."
    ]
    for name in (OTHER, DISTANCE, DIRECTION, CATEGORY):
        if name in captions and (more := captions[name].more_m) is not None:
            lines.append(f"{TITLES[name].capitalize()}: it {change_text(more)}.")
    heeded = numbers.heeded
    lines.append(
        f"Where the distance is contradicted, the predicted depth of the object follows by"
        f" {100 * heeded.mean:.0f} % of what is said ({range_text(heeded, 0, 100.0)} %)."
    )
    return lines
