"""Sums of errors: pairs by frame, groups by distance, category and furniture model."""

from dataclasses import replace

import numpy as np
import pytest

from pretrain.probing.claims import DISTANCE, EMPTY, OTHER, RIGHT
from pretrain.probing.compare import by_category, by_distance, by_model_split, compare, compare_group
from pretrain.probing.findings import findings, sum_up
from pretrain.probing.grounding import MARGIN, MEAN, OBJECT, PIXEL_MEAN, REGIONS, GroundingResult

NAN = float("nan")


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def result(scene):
    """100 frames: 40 chairs, 45 sofas, 15 beds; errors right 1, empty 2 + noise."""
    noise = np.random.default_rng(1)
    chosen = noise.integers(len(scene), size=100)
    objects = [
        replace(
            scene.objects[0],
            category="chair" if i < 40 else "sofa" if i < 85 else "bed",
            model="mine" if i < 10 else "theirs" if i < 30 else "own",
            distance_m=(1.0, 1.5, 2.9, 4.0, 7.0)[i % 5],
        )
        for i in range(100)
    ]
    part = replace(
        scene,
        keys=tuple(f"frame_{i}" for i in range(100)),
        objects=tuple(objects),
        claims=tuple(scene.claims[i] for i in chosen),
    )
    values = {name: noise.normal(2, 0.5, 100) for name in (*scene.claims[0], MEAN, PIXEL_MEAN)}
    values[RIGHT] = noise.normal(1, 0.2, 100)
    errors = {name: dict.fromkeys(REGIONS, value) for name, value in values.items()}
    return GroundingResult(scene=part, errors=errors, depths=values)


def test_differences_are_paired_and_leave_out_frames_without_both(rng):
    right = np.array([1.0, 2.0, NAN, 4.0])
    found = compare({RIGHT: right, EMPTY: np.array([2.0, NAN, 9.0, 6.0])}, rng)
    assert found[RIGHT].num_frames == 3
    assert found[RIGHT].more_m is None
    assert found[EMPTY].num_frames == 2
    assert found[EMPTY].error_m.mean == pytest.approx(4.0)
    assert found[EMPTY].more_m.mean == pytest.approx(1.5)


def test_captions_that_no_frame_has_are_left_out(rng):
    found = compare({RIGHT: np.ones(3), OTHER: np.full(3, NAN)}, rng)
    assert set(found) == {RIGHT}
    assert compare_group("none", {RIGHT: np.full(3, NAN)}, np.ones(3, dtype=bool), rng) is None


def test_interval_agrees_with_the_normal_one(rng):
    extra = np.random.default_rng(2).normal(0.3, 1.0, 400)
    right = np.random.default_rng(3).normal(5, 3, 400)
    more = compare({RIGHT: right, EMPTY: right + extra}, rng)[EMPTY].more_m
    half = 1.96 * extra.std() / 20
    assert more.low == pytest.approx(extra.mean() - half, abs=0.02)
    assert more.high == pytest.approx(extra.mean() + half, abs=0.02)


def test_bins_hold_their_lower_edge(result, rng):
    groups = {g.name: g.num_frames for g in by_distance(result, rng)}
    assert groups == {"under 1.5 m": 20, "1.5 to 3 m": 40, "3 to 5 m": 20, "5 m and more": 20}


def test_rare_categories_have_no_row(result, rng):
    groups = by_category(result, rng)
    assert [(g.name, g.num_frames) for g in groups] == [("sofa", 45), ("chair", 40)]
    part = result.errors[EMPTY][OBJECT][40:85]
    assert groups[0].captions[EMPTY].error_m.mean == pytest.approx(part.mean())


def test_models_are_told_apart_by_their_records(result, rng):
    groups = by_model_split(result, "test frames", {"mine": "train", "theirs": "test"}, rng)
    assert {g.name: g.num_frames for g in groups} == {
        "test frames; hidden: furniture models of training": 10,
        "test frames; hidden: unseen furniture models": 20,
        "test frames; hidden: procedural furniture": 70,
    }
    assert by_model_split(result, "test frames", {}, rng) == []


def test_what_the_right_caption_saves_is_a_share_with_an_interval(result, rng):
    (group,) = (compare_group("all", result.errors_in(OBJECT), np.ones(100, dtype=bool), rng),)
    right, empty = (result.errors[name][OBJECT] for name in (RIGHT, EMPTY))
    assert group.saved.mean == pytest.approx(1 - right.mean() / empty.mean())
    # By the delta method, frames being independent.
    spread = right - empty * right.mean() / empty.mean()
    half = 1.96 * spread.std() / np.sqrt(100) / empty.mean()
    assert group.saved.low == pytest.approx(group.saved.mean - half, abs=0.01)
    assert group.saved.high == pytest.approx(group.saved.mean + half, abs=0.01)


def test_all_comparisons_are_made_and_said(result):
    other = replace(result, errors={n: dict(by, **{MARGIN: by[OBJECT]}) for n, by in result.errors.items()})
    numbers = sum_up({"new": result, "old": other}, "new", {}, 0).numbers
    assert [g.name for g in numbers.subsets] == ["new", "old"]
    assert numbers.about == "new"
    assert set(numbers.regions) == set(REGIONS)
    lines = findings(numbers)
    gain = result.errors[EMPTY][OBJECT].mean() - result.errors[RIGHT][OBJECT].mean()
    share = 100 * gain / result.errors[EMPTY][OBJECT].mean()
    assert f"takes off {share:.0f} %" in lines[0]
    assert any("Wrong distance" in line and "adds" in line for line in lines)
    assert numbers.regions[OBJECT][DISTANCE].num_frames == 100
