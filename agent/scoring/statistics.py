"""Intervals for success rates and for means over seeds. Numbers in, numbers out."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from scipy.special import ndtri

from pretrain.statistics import Interval, Values, check_not_empty, percentiles


def wilson_interval(successes: int, trials: int, *, confidence: float = 0.95) -> Interval:
    """Score interval of a success rate; sensible also at 0 and at ``trials`` successes.

    Raises:
        ValueError: If there are no trials, or more successes than trials.

    Source: Wilson (1927).
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(
            f"{successes} successes of {trials} trials; give 1 trial or more and 0 to all successes"
        )
    z = float(ndtri(0.5 + confidence / 2))
    rate, scale = successes / trials, 1 + z**2 / trials
    center = (rate + z**2 / (2 * trials)) / scale
    half = z / scale * math.sqrt(rate * (1 - rate) / trials + z**2 / (4 * trials**2))
    low = 0.0 if successes == 0 else center - half
    high = 1.0 if successes == trials else center + half
    return Interval(rate, low, high)


def hierarchical_bootstrap_interval(
    groups: Sequence[Values], rng: np.random.Generator, *, confidence: float = 0.95, resamples: int = 2000
) -> Interval:
    """Interval of the mean over seeds of the mean over episodes: seeds are drawn first, then episodes.

    Args:
        groups: One array of episode values per seed.
        rng: Draws the resamples.
        confidence: Share of resamples between the limits.
        resamples: How many.

    Raises:
        ValueError: If there are no seeds, or a seed without values.
    """
    if not groups:
        raise ValueError("0 seeds; give the values of at least one")
    for group in groups:
        check_not_empty(group)
    drawn = rng.integers(len(groups), size=(resamples, len(groups)))
    means = np.empty(drawn.shape)
    for seed, group in enumerate(groups):
        places = drawn == seed
        means[places] = _means_of_resamples(group, int(places.sum()), rng)
    return percentiles(float(np.mean([g.mean() for g in groups])), means.mean(axis=1), confidence)


def pooled_rate_interval(
    groups: Sequence[Values], rng: np.random.Generator, *, confidence: float = 0.95
) -> Interval:
    """As ``hierarchical_bootstrap_interval`` of 0 and 1, but never narrower than Wilson's of all episodes.

    Resampling episodes that all failed knows no doubt, and a single seed says nothing about others.
    """
    drawn = hierarchical_bootstrap_interval(groups, rng, confidence=confidence)
    wins, trials = sum(int(group.sum()) for group in groups), sum(map(len, groups))
    wilson = wilson_interval(wins, trials, confidence=confidence)
    return Interval(drawn.mean, min(drawn.low, wilson.low), max(drawn.high, wilson.high))


def shared_episodes_interval(
    first: Float64[np.ndarray, "S E"],
    second: Float64[np.ndarray, "S2 E2"],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Interval of the mean of ``first`` minus that of ``second``, which played the same episodes.

    Seeds are drawn apart for each, because nothing ties one's seed 0 to the other's; episodes are drawn once
    for both, which takes out what makes an episode hard for anybody.

    Args:
        first: A value for every seed and episode.
        second: The same episodes in the same order, with as many seeds as there are.
        rng: Draws the resamples.
        confidence: Share of resamples between the limits.
        resamples: How many.

    Raises:
        ValueError: If the two have different numbers of episodes, or no values.
    """
    if first.shape[1] != second.shape[1]:
        raise ValueError(
            f"{first.shape[1]} and {second.shape[1]} episodes; a paired comparison needs the same of both"
        )
    for values in (first, second):
        check_not_empty(values.ravel())
    num = first.shape[1]
    episodes = rng.multinomial(num, np.full(num, 1 / num), size=resamples) / num
    means = [
        np.einsum("re,re->r", _seed_weights(values.shape[0], resamples, rng) @ values, episodes)
        for values in (first, second)
    ]
    return percentiles(float(first.mean() - second.mean()), means[0] - means[1], confidence)


def _seed_weights(num: int, resamples: int, rng: np.random.Generator) -> Float64[np.ndarray, "R S"]:
    return rng.multinomial(num, np.full(num, 1 / num), size=resamples) / num


def _means_of_resamples(values: Values, count: int, rng: np.random.Generator) -> Values:
    """Means of ``count`` resamples of ``values``, some at a time so that memory stays small."""
    at_once = max(1, 2**22 // len(values))
    parts = [
        values[rng.integers(len(values), size=(min(at_once, count - start), len(values)))].mean(axis=1)
        for start in range(0, count, at_once)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)
