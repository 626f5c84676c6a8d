import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from agent.scoring.statistics import (
    hierarchical_bootstrap_interval,
    pooled_rate_interval,
    shared_episodes_interval,
    wilson_interval,
)
from pretrain.statistics import bootstrap_interval


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_agrees_with_scipy(case):
    successes, trials = case
    theirs = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    ours = wilson_interval(successes, trials)
    assert ours.low == pytest.approx(theirs.low, abs=1e-9)
    assert ours.high == pytest.approx(theirs.high, abs=1e-9)


def test_wilson_interval_of_published_cells():
    """6.8 % and 5.5 % of 3000 episodes."""
    first, second = wilson_interval(204, 3000), wilson_interval(165, 3000)
    assert (round(100 * first.low, 1), round(100 * first.high, 1)) == (6.0, 7.8)
    assert (round(100 * second.low, 1), round(100 * second.high, 1)) == (4.7, 6.4)


def test_seeds_that_disagree_widen_the_interval():
    rng = np.random.default_rng(0)
    alike = [rng.normal(0, 1, 200) for _ in range(5)]
    apart = [group + shift for group, shift in zip(alike, (-2, -1, 0, 1, 2), strict=True)]
    narrow = hierarchical_bootstrap_interval(alike, np.random.default_rng(1))
    wide = hierarchical_bootstrap_interval(apart, np.random.default_rng(1))
    assert wide.high - wide.low > 4 * (narrow.high - narrow.low)
    assert wide.mean == pytest.approx(narrow.mean)


def test_a_pooled_rate_is_no_surer_than_wilson_nor_than_its_seeds():
    failed = pooled_rate_interval([np.zeros(20), np.zeros(20)], np.random.default_rng(0))
    assert failed == wilson_interval(0, 40)
    groups = [np.repeat([1.0, 0.0], [wins, 40 - wins]) for wins in (38, 2)]
    apart = pooled_rate_interval(groups, np.random.default_rng(0))
    drawn = hierarchical_bootstrap_interval(groups, np.random.default_rng(0))
    assert apart == drawn
    assert drawn.high - drawn.low > 0.8


def test_hierarchical_interval_of_one_seed_is_the_plain_one():
    values = np.random.default_rng(0).normal(size=100)
    one = hierarchical_bootstrap_interval([values], np.random.default_rng(1))
    plain = bootstrap_interval(values, np.random.default_rng(2))
    assert one.low == pytest.approx(plain.low, abs=0.03)
    assert one.high == pytest.approx(plain.high, abs=0.03)


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 5)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match=f"{successes} successes of {trials} trials"):
        wilson_interval(successes, trials)


def test_missing_values_are_refused():
    rng, empty = np.random.default_rng(0), np.zeros(0)
    with pytest.raises(ValueError, match="0 values"):
        hierarchical_bootstrap_interval([np.ones(2), empty], rng)
    with pytest.raises(ValueError, match="0 seeds"):
        hierarchical_bootstrap_interval([], rng)


def test_hierarchical_interval_agrees_with_drawing_one_by_one():
    rng = np.random.default_rng(0)
    groups = [rng.normal(shift, 1, size) for shift, size in ((0.0, 40), (0.4, 60), (1.0, 50))]
    ours = hierarchical_bootstrap_interval(groups, np.random.default_rng(1), resamples=20_000)
    means = [
        np.mean([rng.choice(groups[s], len(groups[s])).mean() for s in rng.integers(3, size=3)])
        for _ in range(20_000)
    ]
    assert (ours.low, ours.high) == pytest.approx(np.quantile(means, [0.025, 0.975]), abs=0.02)
    assert ours.mean == pytest.approx(np.mean([group.mean() for group in groups]))


def test_shared_episodes_agree_with_scipys_paired_bootstrap():
    rng = np.random.default_rng(0)
    hard = rng.normal(size=80)
    first, second = hard + rng.normal(0.2, 0.3, 80), hard + rng.normal(0, 0.3, 80)
    theirs = stats.bootstrap(
        (first, second),
        lambda a, b, axis: (a - b).mean(axis=axis),
        paired=True,
        method="percentile",
        rng=rng,
    ).confidence_interval
    ours = shared_episodes_interval(first[None], second[None], np.random.default_rng(1), resamples=20_000)
    assert (ours.low, ours.high) == pytest.approx(tuple(theirs), abs=0.01)
    assert ours.mean == pytest.approx(first.mean() - second.mean())
    apart = shared_episodes_interval(first[None], np.roll(second, 1)[None], np.random.default_rng(1))
    assert apart.high - apart.low > 2 * (ours.high - ours.low)


def test_shared_episodes_agree_with_drawing_seeds_and_episodes_one_by_one():
    rng = np.random.default_rng(0)
    first, second = rng.normal([[0], [0.5], [1], [1.5]], size=(4, 30)), rng.normal(size=(2, 30))
    differences = []
    for _ in range(20_000):
        episodes, seeds = rng.integers(30, size=30), (rng.integers(4, size=4), rng.integers(2, size=2))
        differences.append(first[seeds[0]][:, episodes].mean() - second[seeds[1]][:, episodes].mean())
    ours = shared_episodes_interval(first, second, np.random.default_rng(1), resamples=20_000)
    assert (ours.low, ours.high) == pytest.approx(np.quantile(differences, [0.025, 0.975]), abs=0.03)


def test_different_or_missing_episodes_cannot_be_compared():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="3 and 4 episodes; a paired comparison needs the same of both"):
        shared_episodes_interval(np.zeros((1, 3)), np.zeros((1, 4)), rng)
    with pytest.raises(ValueError, match="0 values"):
        shared_episodes_interval(np.zeros((0, 3)), np.zeros((1, 3)), rng)
