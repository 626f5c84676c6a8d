"""Intervals for success rates and for means over seeds. Numbers in, numbers out."""

import math

import numpy as np
from jaxtyping import Float64
from scipy.special import ndtri

from pretrain.statistics import Interval, check_not_empty, percentiles


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
    return _wilson(successes / trials, float(trials), confidence)


def seeds_interval(
    values: Float64[np.ndarray, "S E"],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Interval of the mean over seeds and over episodes that all seeds played.

    Seeds and episodes are drawn apart, episodes once for all seeds: what is hard for one seed is hard for the
    others, so that the same episodes played again are no new ones. Seeds are few; their spread is widened by
    the square root of S / (S - 1), of which drawing with replacement robs it. Where neither seeds nor
    episodes differ the interval is too wide, by up to a factor of 1.7.

    Args:
        values: A value for every seed and episode.
        rng: Draws the resamples.
        confidence: Share of resamples between the limits.
        resamples: How many.

    Raises:
        ValueError: If there are no values.

    Source: Owen (2007), "The pigeonhole bootstrap"; Rao and Wu (1988) for the factor.
    """
    check_not_empty(values.ravel())
    episodes = _episode_weights(values.shape[1], resamples, rng)
    return percentiles(float(values.mean()), _resampled_means(values, episodes, rng), confidence)


def seeds_rate_interval(
    values: Float64[np.ndarray, "S E"], rng: np.random.Generator, *, confidence: float = 0.95
) -> Interval:
    """As ``seeds_interval`` for values of 0 and 1, never narrower than Wilson's; of one seed it is Wilson's.

    Resampling episodes that all failed knows no doubt. Wilson's is of as many episodes as those of all seeds
    are worth: S E / (1 + (S - 1) r), r being the intraclass correlation of the seeds' results on an episode.

    Raises:
        ValueError: If there are no values.

    Source: Wilson (1927); Kish (1965) for the worth, the "design effect".
    """
    check_not_empty(values.ravel())
    num_seeds, num_episodes = values.shape
    worth = num_seeds * num_episodes / (1 + (num_seeds - 1) * _correlation(values))
    wilson = _wilson(float(values.mean()), worth, confidence)
    if num_seeds == 1:
        return wilson
    drawn = seeds_interval(values, rng, confidence=confidence)
    return Interval(drawn.mean, max(0.0, min(drawn.low, wilson.low)), min(1.0, max(drawn.high, wilson.high)))


def shared_episodes_interval(
    first: Float64[np.ndarray, "S E"],
    second: Float64[np.ndarray, "S2 E2"],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Interval of the mean of ``first`` minus that of ``second``, which played the same episodes.

    Seeds are drawn apart for each, because nothing ties one's seed 0 to the other's, and widened as in
    ``seeds_interval``; episodes are drawn once for both, which takes out what makes one hard for anybody.

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
    episodes = _episode_weights(first.shape[1], resamples, rng)
    means = [_resampled_means(values, episodes, rng) for values in (first, second)]
    return percentiles(float(first.mean() - second.mean()), means[0] - means[1], confidence)


def _wilson(rate: float, trials: float, confidence: float) -> Interval:
    z = float(ndtri(0.5 + confidence / 2))
    scale = 1 + z**2 / trials
    center = (rate + z**2 / (2 * trials)) / scale
    half = z / scale * math.sqrt(rate * (1 - rate) / trials + z**2 / (4 * trials**2))
    return Interval(rate, 0.0 if rate == 0 else center - half, 1.0 if rate == 1 else center + half)


def _correlation(values: Float64[np.ndarray, "S E"]) -> float:
    """How alike seeds are on an episode, from 0 to 1; 1 where nothing tells episodes apart.

    Source: Fisher's intraclass correlation, by analysis of variance.
    """
    num_seeds, num_episodes = values.shape
    if num_seeds == 1 or num_episodes == 1:
        return 1.0
    between = num_seeds * values.mean(axis=0).var(ddof=1)
    within = values.var(axis=0, ddof=1).mean()
    total = between + (num_seeds - 1) * within
    return 1.0 if total == 0 else float(np.clip((between - within) / total, 0.0, 1.0))


def _episode_weights(num: int, resamples: int, rng: np.random.Generator) -> Float64[np.ndarray, "R E"]:
    return rng.multinomial(num, np.full(num, 1 / num), size=resamples) / num


def _seed_weights(num: int, resamples: int, rng: np.random.Generator) -> Float64[np.ndarray, "R S"]:
    if num == 1:
        return np.ones((resamples, 1))
    drawn = rng.multinomial(num, np.full(num, 1 / num), size=resamples) / num
    return 1 / num + math.sqrt(num / (num - 1)) * (drawn - 1 / num)


def _resampled_means(
    values: Float64[np.ndarray, "S E"], episodes: Float64[np.ndarray, "R E"], rng: np.random.Generator
) -> Float64[np.ndarray, " R"]:
    seeds = _seed_weights(values.shape[0], len(episodes), rng)
    return np.einsum("re,re->r", seeds @ values, episodes)
