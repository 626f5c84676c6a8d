"""Scores and paired differences against computations that share nothing with ours."""

import math

import numpy as np
import pytest

from agent.scoring.statistics import seeds_interval
from agent.scoring.summary import MEANS, compare, mcnemar_exact, pool_runs, summarise


def make_rows(system, success, spl=None, split="test", task="t"):
    rows = []
    for i, won in enumerate(success):
        row = dict.fromkeys(MEANS, 1.0) | {"spl": spl[i] if spl is not None else float(won)}
        row |= {"system": system, "split": split, "scene": "AB"[i % 2], "tier": i % 3}
        rows.append(row | {"episode": i // 2, "task": f"{task}{i}", "success": bool(won)})
    return rows


@pytest.mark.parametrize(("b", "c"), [(0, 0), (0, 5), (5, 0), (3, 9), (10, 10), (1, 2), (60, 31)])
def test_mcnemar_against_the_binomial_sum(b, c):
    n = b + c
    tail = sum(math.comb(n, k) for k in range(min(b, c) + 1)) / 2**n
    assert mcnemar_exact(b, c) == pytest.approx(min(1.0, 2 * tail))


def test_a_paired_interval_covers_the_true_difference_as_often_as_it_says():
    rng = np.random.default_rng(0)
    hits, widths, apart = 0, [], []
    for _ in range(60):
        hard = rng.normal(0, 3, 60)
        a, b = hard + rng.normal(0.5, 1, 60), hard + rng.normal(0, 1, 60)
        rows = make_rows("a", [1] * 60, a) + make_rows("b", [0] * 60, b)
        (found,) = compare(rows, "a", "b")
        interval = found.means["spl"]
        assert interval.mean == pytest.approx((a - b).mean())
        normal = 1.96 * (a - b).std() / math.sqrt(60)
        assert interval.high - interval.low == pytest.approx(2 * normal, rel=0.2)
        hits += interval.low <= 0.5 <= interval.high
        widths.append(interval.high - interval.low)
        apart.append(2 * 1.96 * math.hypot(a.std(), b.std()) / math.sqrt(60))
    assert 51 <= hits <= 60
    assert np.mean(widths) < 0.5 * np.mean(apart)  # what pairing is for


def test_differences_count_who_alone_succeeded():
    rows = make_rows("a", [1, 1, 1, 0, 0, 1]) + make_rows("b", [0, 1, 0, 0, 1, 0])
    (found,) = compare(rows, "a", "b")
    assert (found.only_first, found.only_second, found.num_episodes) == (3, 1, 6)
    assert found.means["success"].mean == pytest.approx(2 / 6)
    assert found.p_value == pytest.approx(0.625)


def test_only_the_same_episodes_are_compared():
    rows = make_rows("a", [1] * 6) + make_rows("b", [0] * 4) + make_rows("c", [0] * 6, task="other")
    (found,) = compare(rows, "a", "b")
    assert found.num_episodes == 4
    assert compare(rows, "a", "c") == []


def test_splits_are_compared_apart():
    rows = [r for s in ("test", "train") for n in "ab" for r in make_rows(n, [1, 0], split=s)]
    assert [d.split for d in compare(rows, "a", "b")] == ["test", "train"]


def test_scores_by_tier_and_floor_add_up():
    scores = summarise(make_rows("a", [1, 0, 1, 1, 0, 0, 1])).scores
    counts = {(s.tier, s.scene): (s.num_episodes, s.success.mean) for s in scores}
    assert counts[None, None] == (7, 4 / 7)
    assert counts[0, None] == (3, 1.0)
    assert counts[None, "A"] == (4, 0.75)
    assert sum(n for (tier, _), (n, _) in counts.items() if tier is not None) == 7


def test_bootstrap_of_a_mean_agrees_with_the_normal_one():
    values = np.random.default_rng(3).exponential(2.0, 400)
    interval = summarise(make_rows("a", [1] * 400, values)).scores[0].means["spl"]
    half = 1.96 * values.std() / 20
    assert (interval.low, interval.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.05
    )


def test_several_runs_of_a_system_are_pooled_by_runs():
    rng = np.random.default_rng(1)
    shifts = (0.0, 1.0, 2.0)
    values = np.array([rng.normal(shift, 1, 200) for shift in shifts])
    rows = [r for i, v in enumerate(values) for r in make_rows(f"s {i}", [1] * 200, v)]
    runs = {f"s {i}": "s" for i in range(3)} | {"other": "o"}
    (score,) = pool_runs([*rows, *make_rows("other", [0] * 200)], runs)
    assert (score.system, score.num_episodes) == ("s, 3 runs", 600)
    assert score.means["spl"].mean == pytest.approx(np.mean([v.mean() for v in values]))
    own = seeds_interval(values, np.random.default_rng(5))
    assert score.means["spl"].high == pytest.approx(own.high, abs=0.1)
    flat = summarise([r | {"system": "s"} for r in rows]).scores[0].means["spl"]
    assert score.means["spl"].high - score.means["spl"].low > 3 * (flat.high - flat.low)


def test_the_text_has_a_line_for_every_difference():
    rows = make_rows("a", [1, 1, 0, 0]) + make_rows("b", [0, 1, 0, 0])
    summary = summarise(rows)
    text = type(summary)(summary.scores, tuple(compare(rows, "a", "b"))).as_text()
    assert "a - b: success 25.0 [0.0, 75.0] points (McNemar p = 1), SPL 0.25" in text
    assert "success % of" in text
    assert "tier 0" in text
