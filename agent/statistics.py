"""Intervals for success rates and for means over seeds. Numbers in, numbers out."""

import math
from collections.abc import Sequence

import numpy as np
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
    means = np.empty(resamples)
    for i in range(resamples):
        seeds = rng.integers(len(groups), size=len(groups))
        means[i] = np.mean([rng.choice(groups[s], size=len(groups[s])).mean() for s in seeds])
    return percentiles(float(np.mean([g.mean() for g in groups])), means, confidence)
