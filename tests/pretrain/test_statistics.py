import numpy as np
import pytest
from scipy import stats

from pretrain.statistics import bootstrap_interval, paired_bootstrap_interval, resampled_interval


def test_bootstrap_interval_agrees_with_scipy():
    values = np.random.default_rng(0).exponential(size=80)
    ours = bootstrap_interval(values, np.random.default_rng(1), resamples=20_000)
    theirs = stats.bootstrap(
        (values,), np.mean, method="percentile", n_resamples=20_000, rng=np.random.default_rng(2)
    ).confidence_interval
    assert ours.mean == pytest.approx(values.mean())
    assert ours.low == pytest.approx(theirs.low, abs=0.02)
    assert ours.high == pytest.approx(theirs.high, abs=0.02)


def test_intervals_repeat_with_the_same_generator():
    values = np.arange(10.0)
    again = [bootstrap_interval(values, np.random.default_rng(3)) for _ in range(2)]
    assert again[0] == again[1]


def test_pairing_removes_what_the_episodes_share():
    rng = np.random.default_rng(0)
    difficulty = rng.normal(0, 10, 100)
    first, second = difficulty + 0.5, difficulty + rng.normal(0, 0.1, 100)
    paired = paired_bootstrap_interval(first, second, np.random.default_rng(1))
    assert 0.4 < paired.low < paired.high < 0.6


def test_bootstrap_interval_agrees_with_the_normal_one():
    values = np.random.default_rng(0).normal(0.3, 1.0, 400)
    found = bootstrap_interval(values, np.random.default_rng(1))
    half = 1.96 * values.std() / 20
    assert found.low == pytest.approx(values.mean() - half, abs=0.02)
    assert found.high == pytest.approx(values.mean() + half, abs=0.02)


def test_interval_of_a_statistic_of_rows_is_that_of_the_mean():
    values = np.random.default_rng(0).normal(size=200)
    found = resampled_interval(
        lambda rows: float(values[rows].mean()), np.arange(200), np.random.default_rng(1), resamples=4000
    )
    plain = bootstrap_interval(values, np.random.default_rng(2), resamples=4000)
    assert found.mean == pytest.approx(plain.mean)
    assert found.low == pytest.approx(plain.low, abs=0.02)
    assert found.high == pytest.approx(plain.high, abs=0.02)


def test_rows_that_are_copies_of_each_other_count_once():
    values = np.repeat(np.random.default_rng(0).normal(size=50), 10)

    def interval(groups):
        return resampled_interval(
            lambda rows: float(values[rows].mean()), groups, np.random.default_rng(1), resamples=1000
        )

    together, apart = interval(np.arange(500) // 10), interval(np.arange(500))
    assert (together.high - together.low) / (apart.high - apart.low) == pytest.approx(10**0.5, rel=0.2)


def test_resamples_without_a_value_are_left_out():
    found = resampled_interval(
        lambda rows: 1.0 if 0 in rows else float("nan"), np.arange(3), np.random.default_rng(0), resamples=50
    )
    assert (found.low, found.mean, found.high) == (1.0, 1.0, 1.0)
    never = resampled_interval(lambda rows: float("nan"), np.arange(3), np.random.default_rng(0))
    assert np.isnan(never.mean)


def test_missing_values_are_refused():
    rng, empty = np.random.default_rng(0), np.zeros(0)
    with pytest.raises(ValueError, match="0 values"):
        bootstrap_interval(empty, rng)
    with pytest.raises(ValueError, match="0 values"):
        resampled_interval(lambda rows: 0.0, empty.astype(int), rng)
    with pytest.raises(ValueError, match="2 and 3 values"):
        paired_bootstrap_interval(np.ones(2), np.ones(3), rng)
