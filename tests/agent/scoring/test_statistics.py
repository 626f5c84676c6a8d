import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from agent.scoring.statistics import (
    seeds_interval,
    seeds_rate_interval,
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
    alike = np.random.default_rng(0).normal(0, 1, (5, 200))
    apart = alike + np.array([[-2], [-1], [0], [1], [2]])
    narrow = seeds_interval(alike, np.random.default_rng(1))
    wide = seeds_interval(apart, np.random.default_rng(1))
    assert wide.high - wide.low > 4 * (narrow.high - narrow.low)
    assert wide.mean == pytest.approx(narrow.mean)


def test_seeds_that_agree_on_every_episode_are_worth_one():
    one = np.random.default_rng(0).normal(size=(1, 100))
    five = seeds_interval(np.repeat(one, 5, axis=0), np.random.default_rng(1))
    single = seeds_interval(one, np.random.default_rng(1))
    assert (five.low, five.high) == pytest.approx((single.low, single.high), abs=0.02)
    wins = (one > 0.3).astype(float)
    five = seeds_rate_interval(np.repeat(wins, 5, axis=0), np.random.default_rng(1))
    single = wilson_interval(int(wins.sum()), 100)
    assert (five.low, five.high) == pytest.approx((single.low, single.high), abs=0.01)


def test_a_rate_of_one_seed_has_wilsons_interval():
    wins = np.repeat([[1.0, 0.0]], [13, 27], axis=1)
    assert seeds_rate_interval(wins, np.random.default_rng(0)) == wilson_interval(13, 40)


def test_a_rate_is_no_surer_than_wilson_nor_than_its_seeds():
    """Two seeds that always fail on the same episodes know no more than one."""
    failed = seeds_rate_interval(np.zeros((2, 20)), np.random.default_rng(0))
    assert failed == wilson_interval(0, 20)
    groups = np.array([np.repeat([1.0, 0.0], [wins, 40 - wins]) for wins in (38, 2)])
    apart = seeds_rate_interval(groups, np.random.default_rng(0))
    assert (apart.low, apart.high) == (0.0, 1.0)


def test_an_episodes_worth_falls_with_how_alike_seeds_are():
    rng = np.random.default_rng(0)
    lone = (rng.random((4, 400)) < 0.5).astype(float)
    widths = []
    for share in (0.0, 0.5, 1.0):
        common = np.where(rng.random((4, 400)) < share, lone[:1], lone)
        found = seeds_rate_interval(common, np.random.default_rng(1))
        widths.append(found.high - found.low)
    assert widths == sorted(widths)
    assert widths[2] > 1.15 * widths[0]


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_intervals_of_seeds_on_shared_episodes_hold_what_they_promise(spread):
    """Easy and hard episodes, better and worse seeds; the truth is the rate over all of both."""
    rng = np.random.default_rng(3)

    def rates(num_seeds, num_episodes):
        skill, ease = rng.normal(0, spread, (num_seeds, 1)), rng.normal(0, 2, (1, num_episodes))
        return 1 / (1 + np.exp(-(0.3 + skill + ease)))

    truth, held, taken_alone = rates(1, 200_000).mean() if spread == 0 else rates(2000, 2000).mean(), 0, 0
    for number in range(300):
        wins = (rng.random((5, 120)) < rates(5, 120)).astype(float)
        found = seeds_rate_interval(wins, np.random.default_rng(number))
        held += found.low <= truth <= found.high
        alone = wilson_interval(int(wins.sum()), wins.size)
        taken_alone += alone.low <= truth <= alone.high
    assert held / 300 > 0.9
    assert taken_alone / 300 < 0.85  # which the same episodes are, if they are taken for new ones


def test_an_interval_of_one_seed_is_the_plain_one():
    values = np.random.default_rng(0).normal(size=100)
    one = seeds_interval(values[None], np.random.default_rng(1))
    plain = bootstrap_interval(values, np.random.default_rng(2))
    assert one.low == pytest.approx(plain.low, abs=0.03)
    assert one.high == pytest.approx(plain.high, abs=0.03)


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 5)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match=f"{successes} successes of {trials} trials"):
        wilson_interval(successes, trials)


def test_missing_values_are_refused():
    rng = np.random.default_rng(0)
    for interval in (seeds_interval, seeds_rate_interval):
        for shape in ((0, 3), (2, 0)):
            with pytest.raises(ValueError, match="0 values"):
                interval(np.zeros(shape), rng)


def widened(values, rng):
    """The mean over seeds drawn with replacement, their spread about the mean widened."""
    num = len(values)
    means = values.mean(axis=1)
    drawn = means[rng.integers(num, size=num)].mean()
    return means.mean() + np.sqrt(num / (num - 1)) * (drawn - means.mean())


def test_the_interval_agrees_with_drawing_one_by_one():
    rng = np.random.default_rng(0)
    values = rng.normal([[0.0], [0.4], [1.0]], 1, (3, 40)) + rng.normal(0, 1, (1, 40))
    ours = seeds_interval(values, np.random.default_rng(1), resamples=20_000)
    means = [widened(values[:, rng.integers(40, size=40)], rng) for _ in range(20_000)]
    assert (ours.low, ours.high) == pytest.approx(np.quantile(means, [0.025, 0.975]), abs=0.03)
    assert ours.mean == pytest.approx(values.mean())


def test_the_variance_of_seeds_is_the_unbiased_one():
    seeds = np.array([[0.1], [0.4], [0.9]]) + np.zeros((1, 50))
    ours = seeds_interval(seeds, np.random.default_rng(0), confidence=0.5, resamples=50_000)
    drawn = np.random.default_rng(1).integers(3, size=(50_000, 3))
    means = seeds[:, 0][drawn].mean(axis=1)
    scaled = means.mean() + np.sqrt(3 / 2) * (means - means.mean())
    assert scaled.var() == pytest.approx(seeds[:, 0].var(ddof=1) / 3, rel=0.02)
    assert (ours.low, ours.high) == pytest.approx(np.quantile(scaled, [0.25, 0.75]), abs=0.02)


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
        episodes = rng.integers(30, size=30)
        differences.append(widened(first[:, episodes], rng) - widened(second[:, episodes], rng))
    ours = shared_episodes_interval(first, second, np.random.default_rng(1), resamples=20_000)
    assert (ours.low, ours.high) == pytest.approx(np.quantile(differences, [0.025, 0.975]), abs=0.03)


def test_different_or_missing_episodes_cannot_be_compared():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="3 and 4 episodes; a paired comparison needs the same of both"):
        shared_episodes_interval(np.zeros((1, 3)), np.zeros((1, 4)), rng)
    with pytest.raises(ValueError, match="0 values"):
        shared_episodes_interval(np.zeros((0, 3)), np.zeros((1, 3)), rng)
