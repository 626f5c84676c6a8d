"""What frozen features know: questions, and scores of what simple readers answer from the features.

Readers are fitted on training frames and scored on the frames of the other split.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from langwm_data.seeding import make_rng
from pretrain.probing.features import SeenFrames
from pretrain.probing.readout import (
    NUM_NEIGHBORS,
    RIDGE_STRENGTHS,
    Reader,
    accuracy,
    make_folds,
    mean_area,
    r2,
    read_by_neighbors,
    read_by_ridge,
    read_out,
    standardise,
)
from pretrain.probing.targets import NOWHERE, categories_present, frequent_categories, next_frames
from pretrain.statistics import resampled_interval

ROOM, PRESENT = "kind of room", "categories in sight"
DISTANCE, BEARING = "distance of the nearest obstacle", "bearing of the nearest obstacle"
NEXT, NEXT_BLIND = "next frame", "next frame, action unknown"
READERS: Mapping[str, tuple[Reader, Sequence[float]]] = {
    "linear": (read_by_ridge, RIDGE_STRENGTHS),
    "kNN": (read_by_neighbors, NUM_NEIGHBORS),
}
LEAST_TRAIN, LEAST_TEST = 20, 10
"""A category is asked for if so many frames show it, and so many do not."""
_RESAMPLES = 200


@dataclass(frozen=True, kw_only=True)
class FeatureScore:
    """One score of one reader of one encoder's features."""

    encoder: str
    features: str
    task: str
    reader: str
    score: str
    value: float
    low: float
    high: float
    chance: float
    """What comes out without looking: the most frequent class, the training mean, no change."""
    num_train: int
    num_test: int
    num_groups: int
    """Of test frames that are drawn together for the interval: drives, or single frames."""
    knob: float


Answers = Float[np.ndarray, "_ K"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A question with its answers."""

    name: str
    score: str
    measure: Callable[[Answers, Answers], float]
    """Of what was read and what is true."""
    train: Answers
    test: Answers
    has_answer: tuple[Bool[np.ndarray, " _"], Bool[np.ndarray, " _"]]
    """Training and test frames that have one."""
    guess: Answers
    """The best answer without looking."""


def make_tasks(train: SeenFrames, test: SeenFrames) -> list[Task]:
    """The questions that frames of both splits have answers to."""
    tasks = [_room_task(train, test), _category_task(train, test)]
    for column, name in enumerate((DISTANCE, BEARING)):
        answers = [seen.obstacles[:, column : column + 1] for seen in (train, test)]
        tasks.append(_number_task(name, answers[0], answers[1]))
    return [t for t in tasks if t.guess.size and t.has_answer[0].sum() > 1 and t.has_answer[1].any()]


def _room_task(train: SeenFrames, test: SeenFrames) -> Task:
    kinds = sorted(set(train.rooms) - {NOWHERE})
    kinds = kinds if len(kinds) > 1 else []  # nothing to tell apart
    answers = [categories_present([[room] for room in seen.rooms], kinds) for seen in (train, test)]
    return Task(
        name=ROOM,
        score="accuracy",
        measure=accuracy,
        train=answers[0],
        test=answers[1],
        has_answer=(answers[0].sum(axis=1) > 0, answers[1].sum(axis=1) > 0),
        guess=answers[0].mean(axis=0, keepdims=True),
    )


def _category_task(train: SeenFrames, test: SeenFrames) -> Task:
    names = frequent_categories(train.categories, test.categories, LEAST_TRAIN, LEAST_TEST)
    answers = [categories_present(seen.categories, names) for seen in (train, test)]
    return Task(
        name=PRESENT,
        score="mean area under the curve",
        measure=mean_area,
        train=answers[0],
        test=answers[1],
        has_answer=(np.ones(len(answers[0]), dtype=np.bool_), np.ones(len(answers[1]), dtype=np.bool_)),
        guess=np.zeros((1, len(names))),
    )


def _number_task(name: str, train: Answers, test: Answers) -> Task:
    has_answer = (np.isfinite(train.sum(axis=1)), np.isfinite(test.sum(axis=1)))
    guess = train[has_answer[0]].mean(axis=0, keepdims=True) if has_answer[0].any() else np.zeros((1, 0))
    return Task(
        name=name,
        score="R2",
        measure=partial(r2, guess=guess),
        train=train,
        test=test,
        has_answer=has_answer,
        guess=guess,
    )


def score_features(train: SeenFrames, test: SeenFrames, seed: int) -> list[FeatureScore]:
    """Every question to every encoder's features by every reader.

    Args:
        train: Frames to fit readers on; each reader's knob is chosen by leaving out whole scenes of them.
        test: Frames to score them on.
        seed: Of the folds of scenes, and of the intervals.
    """
    scores = []
    for task in make_tasks(train, test):
        for name in train.features:
            for reader in READERS:
                scores.append(_score(task, train, test, name, reader, seed))
    for name in train.features:
        scores += score_dynamics(train, test, name, seed)
    return scores


def _score(
    task: Task, train: SeenFrames, test: SeenFrames, name: tuple[str, str], reader: str, seed: int
) -> FeatureScore:
    fit, rows = task.has_answer
    truth = task.test[rows]
    read, knobs = READERS[reader]
    reading = read_out(
        read,
        knobs,
        (train.features[name][fit], task.train[fit]),
        test.features[name][rows],
        make_folds(make_rng(seed, "folds"), train.scenes[fit]),
    )
    interval = resampled_interval(
        lambda chosen: task.measure(reading.predicted[chosen], truth[chosen]),
        test.drives[rows],
        make_rng(seed, "interval", task.name),
        resamples=_RESAMPLES,
    )
    return FeatureScore(
        encoder=name[0],
        features=name[1],
        task=task.name,
        reader=reader,
        score=task.score,
        value=interval.mean,
        low=interval.low,
        high=interval.high,
        chance=task.measure(np.repeat(task.guess, len(truth), axis=0), truth),
        num_train=int(fit.sum()),
        num_test=len(truth),
        num_groups=len(np.unique(test.drives[rows])),
        knob=reading.knob,
    )


def score_dynamics(
    train: SeenFrames, test: SeenFrames, name: tuple[str, str], seed: int
) -> list[FeatureScore]:
    """How well the next frame's features follow, linearly, from this frame's and the action.

    The score is the share of the squared change from one frame to the next that is foreseen: 0 is as good as
    saying that nothing changes. Each feature counts in units of its own spread.

    Returns:
        The score with the action known, and with it unknown; nothing without drives in both splits.
    """
    pairs = [next_frames(seen.table) for seen in (train, test)]
    if not all(len(held) > 1 for held, _ in pairs):
        return []
    known = standardise(train.features[name], test.features[name])
    now = [values[held[:, 0]] for values, (held, _) in zip(known, pairs, strict=True)]
    change = [values[held[:, 1]] - values[held[:, 0]] for values, (held, _) in zip(known, pairs, strict=True)]
    first_train, first_test = (held[:, 0] for held, _ in pairs)
    folds = make_folds(make_rng(seed, "folds"), train.scenes[first_train])
    scores = []
    for task, is_known in ((NEXT, True), (NEXT_BLIND, False)):
        inputs = [
            np.concatenate([x, actions], axis=1) if is_known else x
            for x, (_, actions) in zip(now, pairs, strict=True)
        ]
        reading = read_out(read_by_ridge, RIDGE_STRENGTHS, (inputs[0], change[0]), inputs[1], folds)
        interval = resampled_interval(
            lambda rows, p=reading.predicted: r2(p[rows], change[1][rows], np.zeros_like(change[1][:1])),
            test.drives[first_test],
            make_rng(seed, "interval", task),
            resamples=_RESAMPLES,
        )
        scores.append(
            FeatureScore(
                encoder=name[0],
                features=name[1],
                task=task,
                reader="linear",
                score="share of the change foreseen",
                value=interval.mean,
                low=interval.low,
                high=interval.high,
                chance=0.0,
                num_train=len(first_train),
                num_test=len(first_test),
                num_groups=len(np.unique(test.drives[first_test])),
                knob=reading.knob,
            )
        )
    return scores
