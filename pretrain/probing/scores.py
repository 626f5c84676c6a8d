"""What frozen features know: questions, and scores of what simple readers answer from the features.

Readers are fitted on training frames and scored on the frames of the other split.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Question:
    """A task put to the features of one encoder, on the rows that have an answer."""

    task: str
    score: str
    measure: Callable[[Answers, Answers], float]
    guess: Answers
    train: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Features and answers."""
    test: tuple[NDArray[np.float64], NDArray[np.float64]]
    scenes: NDArray[np.int64]
    """Of the training rows, for the folds."""
    drives: NDArray[np.int64]
    """Of the test rows, which are drawn together for the interval."""


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
    tasks, names = make_tasks(train, test), list(train.features)
    scores = [
        _score(_ask(task, train, test, name), name, reader, seed)
        for task in tasks
        for name in names
        for reader in READERS
    ]
    return scores + [score for name in names for score in score_dynamics(train, test, name, seed)]


def score_dynamics(
    train: SeenFrames, test: SeenFrames, name: tuple[str, str], seed: int
) -> list[FeatureScore]:
    """How well the next frame's features follow, linearly, from this frame's and the action.

    The score is the share of the squared change from one frame to the next that is foreseen: 0 is as good as
    saying that nothing changes. Each feature counts in units of its own spread.

    Returns:
        The score with the action known, and with it unknown; nothing without drives in both splits.
    """
    splits = (train, test)
    pairs, actions = zip(*(next_frames(seen.table) for seen in splits), strict=True)
    if min(map(len, pairs)) < 2:
        return []
    values = standardise(*(seen.features[name] for seen in splits))
    now, then = ([v[p[:, i]] for v, p in zip(values, pairs, strict=True)] for i in (0, 1))
    known = [np.concatenate(parts, axis=1) for parts in zip(now, actions, strict=True)]
    change = [after - before for before, after in zip(now, then, strict=True)]
    still = np.zeros_like(change[0][:1])
    scores = []
    for task, inputs in ((NEXT, known), (NEXT_BLIND, now)):
        question = Question(
            task=task,
            score="share of the change foreseen",
            measure=partial(r2, guess=still),
            guess=still,
            train=(inputs[0], change[0]),
            test=(inputs[1], change[1]),
            scenes=train.scenes[pairs[0][:, 0]],
            drives=test.drives[pairs[1][:, 0]],
        )
        scores.append(_score(question, name, "linear", seed))
    return scores


def _ask(task: Task, train: SeenFrames, test: SeenFrames, name: tuple[str, str]) -> Question:
    fit, rows = task.has_answer
    return Question(
        task=task.name,
        score=task.score,
        measure=task.measure,
        guess=task.guess,
        train=(train.features[name][fit], task.train[fit]),
        test=(test.features[name][rows], task.test[rows]),
        scenes=train.scenes[fit],
        drives=test.drives[rows],
    )


def _score(question: Question, name: tuple[str, str], reader: str, seed: int) -> FeatureScore:
    read, knobs = READERS[reader]
    inputs, truth = question.test
    folds = make_folds(make_rng(seed, "folds"), question.scenes)
    reading = read_out(read, knobs, question.train, inputs, folds)
    interval = resampled_interval(
        lambda rows: question.measure(reading.predicted[rows], truth[rows]),
        question.drives,
        make_rng(seed, "interval", question.task),
        resamples=_RESAMPLES,
    )
    return FeatureScore(
        encoder=name[0],
        features=name[1],
        task=question.task,
        reader=reader,
        score=question.score,
        value=interval.mean,
        low=interval.low,
        high=interval.high,
        chance=question.measure(np.repeat(question.guess, len(truth), axis=0), truth),
        num_train=len(folds),
        num_test=len(truth),
        num_groups=len(np.unique(question.drives)),
        knob=reading.knob,
    )
