"""Simple readers of frozen features: ridge regression and nearest neighbours, and scores of what they read.

Pure functions of arrays. Classes are read as numbers, 1 where something is so and 0 where not, and the
largest wins; so one closed form does for all tasks, and nothing is fitted by chance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import rankdata

Features = Float[np.ndarray, "_ F"]
Targets = Float[np.ndarray, "_ K"]

RIDGE_STRENGTHS = tuple(10.0**power for power in range(-4, 4))
"""Of the penalty, in units of the number of frames: features are standardised."""
NUM_NEIGHBORS = (1.0, 5.0, 20.0, 50.0)
_CHUNK = 512
_NUM_FOLDS = 5


@dataclass(frozen=True)
class Reading:
    """What was read from the test frames."""

    predicted: Float[np.ndarray, "N K"]
    knob: float
    """The strength or the number of neighbours that the validation frames chose."""


Reader = Callable[[Features, Targets, Features, Sequence[float]], Float[np.ndarray, "S _ K"]]
"""Fits the first two, and reads the third with every knob."""


def standardise(train: Features, *others: Features) -> list[Features]:
    """All features in units of the training frames' mean and spread; what never varies becomes 0."""
    mean, spread = train.mean(axis=0), train.std(axis=0)
    scale = np.where(spread > 1e-6 * max(float(spread.max(initial=0.0)), 1e-12), spread, np.inf)
    return [(x - mean) / scale for x in (train, *others)]


def read_by_ridge(
    train: Features, targets: Targets, test: Features, strengths: Sequence[float]
) -> Float[np.ndarray, "S _ K"]:
    """Least squares with a squared penalty on the weights, but not on the offset.

    Args:
        train: Features to fit.
        targets: What should be read from them.
        test: Features to read.
        strengths: Penalties, each times the number of training frames.
    """
    center, offset = train.mean(axis=0), targets.mean(axis=0)
    values, vectors = np.linalg.eigh((train - center).T @ (train - center))
    seen = vectors.T @ ((train - center).T @ (targets - offset))
    read = (test - center) @ vectors
    shrunk = [seen / (np.maximum(values, 0) + s * len(train))[:, None] for s in strengths]
    return np.stack([read @ weights + offset for weights in shrunk])


def read_by_neighbors(
    train: Features, targets: Targets, test: Features, counts: Sequence[float]
) -> Float[np.ndarray, "S _ K"]:
    """The mean target of the nearest training frames, by straight distance between features."""
    limits = [min(int(k), len(train)) for k in counts]
    parts = []
    for start in range(0, len(test), _CHUNK):
        part = test[start : start + _CHUNK]
        distance = (train**2).sum(axis=1) - 2 * part @ train.T
        nearest = np.argsort(distance, axis=1, kind="stable")[:, : max(limits)]
        parts.append(np.stack([targets[nearest[:, :k]].mean(axis=1) for k in limits]))
    return np.concatenate(parts, axis=1)


def read_out(
    reader: Reader,
    knobs: Sequence[float],
    train: tuple[Features, Targets],
    test: Features,
    folds: Int[np.ndarray, " N"],
) -> Reading:
    """Choose a knob by cross-validation on the training frames, then read the test frames after all of them.

    Args:
        reader: How.
        knobs: To choose from, by squared error.
        train: Features, standardised here, and targets.
        test: Features.
        folds: For each training frame the number of the fold in which it is left out.
    """
    features, targets = train
    errors = np.zeros(len(knobs))
    for fold in np.unique(folds):
        is_out = folds == fold
        fit, valid = standardise(features[~is_out], features[is_out])
        tried = reader(fit, targets[~is_out], valid, knobs)
        errors += ((tried - targets[is_out]) ** 2).sum(axis=(1, 2))
    best = int(errors.argmin())
    seen, unseen = standardise(features, test)
    return Reading(reader(seen, targets, unseen, knobs[best : best + 1])[0], float(knobs[best]))


def r2(predicted: Targets, truth: Targets, guess: Targets) -> float:
    """The share of the squared error of ``guess`` that is gone; 1 is perfect, 0 no better than it."""
    return 1 - float(((predicted - truth) ** 2).sum() / max(((guess - truth) ** 2).sum(), 1e-12))


def accuracy(predicted: Targets, truth: Targets) -> float:
    """How often the largest number is that of the true class."""
    return float((predicted.argmax(axis=1) == truth.argmax(axis=1)).mean())


def area_under_curve(scores: Float[np.ndarray, " N"], is_so: Bool[np.ndarray, " N"]) -> float:
    """How often a case that is so has a higher score than one that is not; ties count half.

    Not a number where all cases are alike. Source: Mann and Whitney (1947).
    """
    positives = int(is_so.sum())
    negatives = len(is_so) - positives
    if not positives or not negatives:
        return float("nan")
    ranks = rankdata(scores)
    return float((ranks[is_so].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def mean_area(predicted: Targets, truth: Targets) -> float:
    """Mean area under the curve over the columns that have cases of both kinds."""
    areas = np.array([area_under_curve(p, t > 0.5) for p, t in zip(predicted.T, truth.T, strict=True)])
    return float(np.nanmean(areas)) if np.isfinite(areas).any() else float("nan")


def make_folds(rng: np.random.Generator, groups: Int[np.ndarray, " N"]) -> Int[np.ndarray, " N"]:
    """Numbers of up to five folds for cross-validation, in whole groups where there are several."""
    names, number = np.unique(groups, return_inverse=True)
    if len(names) == 1:
        number = np.arange(len(groups))
    return rng.permutation(number.max() + 1)[number] % _NUM_FOLDS
