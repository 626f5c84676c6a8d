"""What errors say: means with intervals, differences paired by frame, by distance, category and subset.

Pure functions of arrays. Nothing here knows a model.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pretrain.probing.claims import DISTANCE, EMPTY, RIGHT, Claims
from pretrain.probing.grounding import OBJECT, Errors, GroundingResult
from pretrain.statistics import (
    Interval,
    bootstrap_interval,
    paired_bootstrap_interval,
    resampled_interval,
)

DISTANCE_EDGES_M = (0.0, 1.5, 3.0, 5.0, np.inf)
MIN_CATEGORY_ROWS = 20
"""Categories hidden in fewer frames have no row of their own."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One caption or baseline beside the right caption, on the frames that have both."""

    num_frames: int
    error_m: Interval
    more_m: Interval | None
    """Than with the right caption, paired by frame; ``None`` for the right caption itself."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """Some of the frames."""

    name: str
    num_frames: int
    captions: Mapping[str, Comparison]
    saved: Interval
    """The share of the error with an empty caption that the right one takes off."""


def compare(errors: Mapping[str, Errors], rng: np.random.Generator) -> dict[str, Comparison]:
    """Every caption beside the right one, over the frames in which both errors are numbers.

    Args:
        errors: By caption, one number per frame; one of them is ``right``.
        rng: Draws the resamples.
    """
    right, found = errors[RIGHT], {}
    for name, values in errors.items():
        has_both = np.isfinite(values) & np.isfinite(right)
        if has_both.any():
            more = None
            if name != RIGHT:
                more = paired_bootstrap_interval(values[has_both], right[has_both], rng)
            found[name] = Comparison(
                num_frames=int(has_both.sum()), error_m=bootstrap_interval(values[has_both], rng), more_m=more
            )
    return found


def compare_group(
    name: str, errors: Mapping[str, Errors], where: Mask, rng: np.random.Generator
) -> Group | None:
    """``compare`` on some of the frames; ``None`` where none of them has an error."""
    part = {caption: values[where] for caption, values in errors.items()}
    num_frames = int(np.isfinite(part[RIGHT]).sum())
    if num_frames == 0:
        return None
    return Group(name=name, num_frames=num_frames, captions=compare(part, rng), saved=_saved(part, rng))


def _saved(errors: Mapping[str, Errors], rng: np.random.Generator) -> Interval:
    """Of two means over the same frames; those frames are drawn together."""
    right, empty = (errors[name][np.isfinite(errors[RIGHT])] for name in (RIGHT, EMPTY))
    return resampled_interval(
        lambda rows: 1 - float(right[rows].mean() / empty[rows].mean()), np.arange(len(right)), rng
    )


def by_distance(result: GroundingResult, rng: np.random.Generator) -> list[Group]:
    """A group for each bin of the hidden object's distance."""
    distance = np.array([o.distance_m for o in result.scene.objects])
    bins = np.searchsorted(DISTANCE_EDGES_M, distance, side="right") - 1
    named = {_bin_name(i): bins == i for i in range(len(DISTANCE_EDGES_M) - 1)}
    return _groups(result, named, rng)


def by_category(result: GroundingResult, rng: np.random.Generator) -> list[Group]:
    """A group for each category hidden often enough, the most frequent first."""
    category = np.array([o.category for o in result.scene.objects])
    names, counts = np.unique(category, return_counts=True)
    often = [str(n) for n in names[np.argsort(-counts, kind="stable")]]
    named = {n: category == n for n in often if (category == n).sum() >= MIN_CATEGORY_ROWS}
    return _groups(result, named, rng)


def by_model_split(
    result: GroundingResult, title: str, split_of: Mapping[str, str], rng: np.random.Generator
) -> list[Group]:
    """Groups by which split's furniture models the hidden objects are.

    Args:
        result: What was measured.
        title: Of the frames, for the names of the groups.
        split_of: The split of each model that the dataset's scenes have on record; none if it is empty.
        rng: Draws the resamples.
    """
    splits = np.array([split_of.get(o.model, "") for o in result.scene.objects])
    named = {
        f"{title}; hidden: furniture models of training": splits == "train",
        f"{title}; hidden: unseen furniture models": splits == "test",
        f"{title}; hidden: procedural furniture": splits == "",
    }
    return _groups(result, named, rng) if split_of else []


def heed_distance(
    claims: tuple[Claims, ...], depths: Mapping[str, Errors], rng: np.random.Generator
) -> Interval:
    """How far predictions follow a contradicted distance: 0 not at all, 1 by as many metres as are said.

    The mean over frames of the change of the object's predicted depth, against the right caption, as a
    share of the change of the distance that is told.
    """
    told = np.array([c[DISTANCE].distance_m - c[RIGHT].distance_m for c in claims])
    share = (depths[DISTANCE] - depths[RIGHT]) / told
    return bootstrap_interval(share[np.isfinite(share)], rng)


def _groups(result: GroundingResult, named: Mapping[str, Mask], rng: np.random.Generator) -> list[Group]:
    errors = result.errors_in(OBJECT)
    found = [compare_group(name, errors, where, rng) for name, where in named.items()]
    return [group for group in found if group is not None]


def _bin_name(number: int) -> str:
    low, high = DISTANCE_EDGES_M[number : number + 2]
    if low == 0:
        return f"under {high:g} m"
    return f"{low:g} to {high:g} m" if np.isfinite(high) else f"{low:g} m and more"
