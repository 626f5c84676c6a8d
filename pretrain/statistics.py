"""Intervals of means by the bootstrap, with and without pairs. Numbers in, numbers out."""

from collections.abc import Callable, Sized
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.floating]
"""One number for each frame or episode."""

_DRAWN_AT_ONCE = 2**18
"""Values of resamples in memory: a few megabytes, which a processor's cache holds."""


@dataclass(frozen=True)
class Interval:
    """A point estimate between its limits."""

    mean: float
    low: float
    high: float

    def as_text(self, digits: int, scale: float = 1.0) -> str:
        """Such as ``12.3 [10.1, 14.5]``."""
        mean, low, high = (f"{scale * value:.{digits}f}" for value in (self.mean, self.low, self.high))
        return f"{mean} [{low}, {high}]"


def bootstrap_interval(
    values: Values, rng: np.random.Generator, *, confidence: float = 0.95, resamples: int = 2000
) -> Interval:
    """Percentile interval of a mean.

    Raises:
        ValueError: If there are no values.
    """
    check_not_empty(values)
    means = _resampled_means(values, rng, resamples)
    return percentiles(float(values.mean()), means, confidence)


def paired_bootstrap_interval(
    first: Values,
    second: Values,
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Interval of the mean of ``first - second``, of which pairs are drawn together.

    Raises:
        ValueError: If the two have different lengths or no values.
    """
    if len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} values; a paired comparison needs as many of both")
    return bootstrap_interval(first - second, rng, confidence=confidence, resamples=resamples)


def resampled_interval(
    statistic: Callable[[NDArray[np.intp]], float],
    groups: NDArray[np.integer],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 500,
) -> Interval:
    """Percentile interval of any statistic of rows, of which those of one group are drawn together.

    Args:
        statistic: Computes it from the numbers of rows, which may occur several times.
        groups: For each row the number of its group, from 0: all different where rows are independent.
        rng: Draws the resamples.
        confidence: Share of resamples between the limits.
        resamples: How many; those for which the statistic is not a number are left out.

    Raises:
        ValueError: If there are no rows.
    """
    check_not_empty(groups)
    order = np.argsort(groups, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(groups[order])) + 1)
    values = np.empty(resamples)
    for i in range(resamples):
        drawn = rng.integers(len(members), size=len(members))
        values[i] = statistic(np.concatenate([members[group] for group in drawn]))
    return percentiles(statistic(np.arange(len(groups))), values[np.isfinite(values)], confidence)


def check_not_empty(values: Sized) -> None:
    """Refuse to make an interval of nothing.

    Raises:
        ValueError: If there are no values.
    """
    if len(values) == 0:
        raise ValueError("0 values; give at least one")


def percentiles(mean: float, means: Values, confidence: float) -> Interval:
    """The interval between two quantiles of resampled values; of the estimate alone where there are none."""
    if len(means) == 0:
        return Interval(mean, mean, mean)
    tail = (1 - confidence) / 2
    low, high = np.quantile(means, [tail, 1 - tail])
    return Interval(mean, float(low), float(high))


def _resampled_means(values: Values, rng: np.random.Generator, resamples: int) -> Values:
    at_once = max(_DRAWN_AT_ONCE // len(values), 1)
    means = []
    for start in range(0, resamples, at_once):
        size = (min(at_once, resamples - start), len(values))
        means.append(values[rng.integers(len(values), size=size)].mean(axis=1))
    return np.concatenate(means)
