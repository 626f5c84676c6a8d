"""Readers and scores beside plain loops, closed forms and SciPy."""

import numpy as np
import pytest
from scipy import stats

from pretrain.probing.readout import (
    RIDGE_STRENGTHS,
    accuracy,
    area_under_curve,
    make_folds,
    mean_area,
    r2,
    read_by_neighbors,
    read_by_ridge,
    read_out,
    standardise,
)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_ridge_is_least_squares_with_penalty_rows(rng):
    train, test = rng.normal(size=(50, 7)) + 3, rng.normal(size=(5, 7))
    targets = rng.normal(size=(50, 2)) + 1
    read = read_by_ridge(train, targets, test, (0.01, 2.0))
    for strength, ours in zip((0.01, 2.0), read, strict=True):
        center, offset = train.mean(axis=0), targets.mean(axis=0)
        rows = np.vstack([train - center, np.sqrt(strength * 50) * np.eye(7)])
        wanted = np.vstack([targets - offset, np.zeros((7, 2))])
        weights = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        np.testing.assert_allclose(ours, (test - center) @ weights + offset, atol=1e-9)


def test_neighbours_are_those_of_a_plain_loop(rng, monkeypatch):
    monkeypatch.setattr("pretrain.probing.readout._CHUNK", 4)
    train, test, targets = rng.normal(size=(30, 3)), rng.normal(size=(9, 3)), rng.normal(size=(30, 2))
    read = read_by_neighbors(train, targets, test, (1.0, 5.0, 100.0))
    for k, ours in zip((1, 5, 30), read, strict=True):
        for i, x in enumerate(test):
            nearest = sorted(range(30), key=lambda j, x=x: np.linalg.norm(train[j] - x))[:k]
            np.testing.assert_allclose(ours[i], targets[nearest].mean(axis=0))


def test_area_is_that_of_mann_and_whitney(rng):
    scores = np.round(rng.normal(size=200), 1)  # with ties
    is_so = rng.random(200) < 0.3
    statistic = stats.mannwhitneyu(scores[is_so], scores[~is_so]).statistic
    expected = statistic / (is_so.sum() * (~is_so).sum())
    assert area_under_curve(scores, is_so) == pytest.approx(expected)
    assert area_under_curve(np.arange(4.0), np.array([False, False, True, True])) == 1
    assert area_under_curve(np.zeros(4), np.array([False, False, True, True])) == 0.5
    assert np.isnan(area_under_curve(scores, np.ones(200, dtype=bool)))


def test_mean_area_leaves_out_what_is_always_so():
    truth = np.array([[1.0, 1.0], [0.0, 1.0]])
    assert mean_area(truth, truth) == 1.0
    assert np.isnan(mean_area(truth[:, 1:], truth[:, 1:]))


def test_scores_at_their_limits():
    truth, guess = np.array([[1.0], [3.0]]), np.array([[2.0]])
    assert r2(truth, truth, guess) == 1
    assert r2(np.full((2, 1), 2.0), truth, guess) == 0
    assert r2(np.full((2, 1), 4.0), truth, guess) == pytest.approx(1 - 10 / 2)
    assert accuracy(np.array([[0.9, 0.1], [0.2, 0.1]]), np.array([[1.0, 0.0], [0.0, 1.0]])) == 0.5


def test_standard_units_are_those_of_the_training_frames(rng):
    train, test = rng.normal(3, 5, size=(100, 4)), rng.normal(3, 5, size=(10, 4))
    train[:, 2] = 7.0
    ours, other = standardise(train, test)
    np.testing.assert_allclose(ours.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(ours.std(axis=0), [1, 1, 0, 1])
    np.testing.assert_allclose(other[:, 0], (test[:, 0] - train[:, 0].mean()) / train[:, 0].std())
    assert (other[:, 2] == 0).all()


def test_what_is_linear_in_the_features_is_read_and_what_is_not_there_is_not(rng):
    features = rng.normal(size=(700, 20)) * rng.uniform(0.1, 9, 20)
    linear = features @ rng.normal(size=(20, 1)) + 4
    noise = rng.normal(size=(700, 1))
    folds = make_folds(rng, np.arange(400) // 20)
    for targets, low, high in ((linear, 0.999, 1.0), (noise, -0.1, 0.1)):
        reading = read_out(
            read_by_ridge, RIDGE_STRENGTHS, (features[:400], targets[:400]), features[400:], folds
        )
        found = r2(reading.predicted, targets[400:], targets[:400].mean(axis=0, keepdims=True))
        assert low <= found <= high
        assert (reading.knob <= 1e-3) == (low > 0.5)  # noise is best not read at all


def test_whole_groups_are_left_out_together(rng):
    folds = make_folds(rng, np.arange(100) // 10)
    assert np.bincount(folds).tolist() == [20] * 5
    assert all(len(set(folds[g * 10 : g * 10 + 10])) == 1 for g in range(10))
    assert np.bincount(make_folds(rng, np.zeros(50, dtype=np.int64))).tolist() == [10] * 5
    assert set(make_folds(rng, np.arange(60) // 20)) == {0, 1, 2}


def test_the_knob_is_the_best_over_all_folds(rng):
    features, folds = rng.normal(size=(90, 30)), np.arange(90) % 3
    targets = features[:, :1] + rng.normal(size=(90, 1))
    errors = []
    for strength in RIDGE_STRENGTHS:
        total = 0.0
        for fold in range(3):
            out = folds == fold
            fit, valid = standardise(features[~out], features[out])
            read = read_by_ridge(fit, targets[~out], valid, (strength,))[0]
            total += float(((read - targets[out]) ** 2).sum())
        errors.append(total)
    reading = read_out(read_by_ridge, RIDGE_STRENGTHS, (features, targets), features[:2], folds)
    assert reading.knob == RIDGE_STRENGTHS[int(np.argmin(errors))]
