import numpy as np
import pytest
from grid_folders import begin_grid, make_rows, write_cell
from scipy import stats

from agent.benchmark.grid import Cell
from agent.benchmark.notes import table_notes
from agent.benchmark.record import Record
from agent.benchmark.results import read_results
from agent.benchmark.scores import differences, score_split


@pytest.fixture(scope="module")
def results(finished):
    return read_results(finished)


def rows_of(system, seeds, **fixed):
    rates = {"langwm": 0.6, "random": 0.02, "turn-to-goal": 0.8}
    rows = [row for seed in seeds for row in make_rows(system, seed, rates[system])]
    return [row for row in rows if all(row[k] == v for k, v in fixed.items())]


def test_a_floor_of_one_seed_has_wilsons_interval(results):
    score = score_split(results, "test")["turn-to-goal"].floors["Maple_1"]
    rows = rows_of("turn-to-goal", (0,), scene="Maple_1")
    wins = sum(row["success"] for row in rows)
    theirs = stats.binomtest(wins, 20).proportion_ci(0.95, method="wilson")
    assert (len(rows), score.num_episodes, score.num_seeds) == (20, 20, 1)
    assert (score.success.low, score.success.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_a_floor_of_two_seeds_is_no_surer_than_as_many_new_episodes_would_be(results):
    score = score_split(results, "test")["langwm"].floors["Maple_1"]
    rows = rows_of("langwm", (0, 1), scene="Maple_1")
    wins = sum(row["success"] for row in rows)
    theirs = stats.binomtest(wins, 40).proportion_ci(0.95, method="wilson")
    assert (len(rows), score.num_episodes, score.num_seeds) == (40, 20, 2)
    assert score.success.mean == pytest.approx(wins / 40)
    assert score.success.low < theirs.low
    assert score.success.high > theirs.high
    assert score.spl.mean == pytest.approx(np.mean([row["spl"] for row in rows]))


def test_the_average_is_the_mean_of_the_floors(results):
    for scores in score_split(results, "test").values():
        floors = scores.floors.values()
        assert len(floors) == 3
        for measure in ("success", "spl", "soft_spl", "distance_to_goal"):
            cells = [getattr(floor, measure).mean for floor in floors]
            assert getattr(scores.average, measure).mean == pytest.approx(np.mean(cells))


def test_with_one_seed_the_average_agrees_with_scipys_bootstrap(results):
    score = score_split(results, "test")["turn-to-goal"].average
    values = np.array([row["soft_spl"] for row in rows_of("turn-to-goal", (0,), split="test")])
    rng = np.random.default_rng(0)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", rng=rng).confidence_interval
    assert (score.soft_spl.low, score.soft_spl.high) == pytest.approx(tuple(theirs), abs=0.01)


def test_rates_over_floors_are_never_surer_than_wilson(results):
    for scores in score_split(results, "test").values():
        for score in (scores.average, *scores.tiers.values()):
            count = score.num_episodes * score.num_seeds
            wilson = stats.binomtest(round(score.success.mean * count), count).proportion_ci(method="wilson")
            assert score.success.low <= wilson.low + 1e-9
            assert score.success.high >= wilson.high - 1e-9


def test_an_agent_that_never_arrives_is_not_taken_for_one_that_never_will(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    write_cell(tmp_path, grid, Cell("langwm", 0), rate=0.0)
    success = score_split(read_results(tmp_path), "test")["langwm"].average.success
    assert (success.mean, success.low) == (0, 0)
    assert success.high == pytest.approx(stats.binomtest(0, 60).proportion_ci(method="wilson").high)


def test_tiers_are_of_both_splits_apart(results):
    for split in ("test", "train"):
        tiers = score_split(results, split)["langwm"].tiers
        rows = rows_of("langwm", (0, 1), split=split, tier=1)
        assert set(tiers) == {0, 1}
        assert tiers[1].success.mean == pytest.approx(np.mean([row["success"] for row in rows]))
        contact = sum(r["collisions"] for r in rows) / sum(r["length"] for r in rows)
        assert tiers[1].collision_share == pytest.approx(contact)


def test_differences_are_means_over_shared_episodes(results):
    found = differences(results, "test", "langwm")
    assert set(found) == {"random", "straight-ahead", "turn-to-goal"}
    ours = np.mean([row["spl"] for row in rows_of("langwm", (0, 1), split="test")])
    theirs = np.mean([row["spl"] for row in rows_of("turn-to-goal", (0,), split="test")])
    assert found["turn-to-goal"]["spl"].mean == pytest.approx(theirs - ours)
    assert found["random"]["success"].high < 0
    assert differences(results, "test", "curl") == {}


def test_seeds_on_other_episodes_are_told_apart(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    write_cell(tmp_path, grid, Cell("langwm", 0))
    rows = make_rows("langwm", 1, 0.5)
    for row in rows:
        row["episode"] += 1
    write_cell(tmp_path, grid, Cell("langwm", 1), rows=rows)
    with pytest.raises(ValueError, match="langwm/seed-1 was scored on other episodes than the seeds before"):
        read_results(tmp_path)


def test_seeds_with_other_tasks_under_the_same_numbers_are_told_apart(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    write_cell(tmp_path, grid, Cell("langwm", 0))
    rows = make_rows("langwm", 1, 0.5)
    rows[3]["task"] = "to the kitchen"
    write_cell(tmp_path, grid, Cell("langwm", 1), rows=rows)
    with pytest.raises(ValueError, match="langwm/seed-1 was scored on other episodes than the seeds before"):
        read_results(tmp_path)


def test_systems_with_other_tasks_are_not_compared(tmp_path):
    grid = begin_grid(tmp_path, "langwm,random", "0")
    write_cell(tmp_path, grid, Cell("langwm", 0))
    rows = [row | {"task": f"another {row['task']}"} for row in make_rows("random", 0, 0.5)]
    write_cell(tmp_path, grid, Cell("random", 0), rows=rows)
    assert differences(read_results(tmp_path), "test", "langwm") == {}


def test_a_grid_that_is_being_scored_further_is_taken_as_far_as_all_seeds_are(tmp_path):
    grid = begin_grid(tmp_path, "langwm,random")
    write_cell(tmp_path, grid, Cell("langwm", 0), rows=make_rows("langwm", 0, 0.5, count=30))
    write_cell(tmp_path, grid, Cell("langwm", 1))
    write_cell(tmp_path, grid, Cell("random", 0), rows=make_rows("random", 0, 0.1, count=30))
    results = read_results(tmp_path)
    found = score_split(results, "test")
    assert [found[name].average.num_episodes for name in ("langwm", "random")] == [60, 90]
    both = [results.played["test"][name].values["success"].mean(axis=0) for name in ("langwm", "random")]
    shared = results.played["test"]["random"].episode < 20
    expected = both[1][shared].mean() - both[0].mean()
    assert differences(results, "test", "langwm")["random"]["success"].mean == pytest.approx(expected)
    assert any("60 to 90 with every seed" in note for note in table_notes(results))


def test_only_splits_that_are_scored_to_their_end_count(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    write_cell(tmp_path, grid, Cell("langwm", 0))
    half = Record(state="unfinished", scored={"test": 20})
    write_cell(tmp_path, grid, Cell("langwm", 1), record=half)
    results = read_results(tmp_path)
    assert results.played["test"]["langwm"].seeds == (0, 1)
    assert results.played["train"]["langwm"].seeds == (0,)


def test_rows_of_others_that_were_scored_beside_a_learner_are_left_out(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    rows = make_rows("langwm", 0, 1.0) + make_rows("random", 0, 0.0)
    write_cell(tmp_path, grid, Cell("langwm", 0), rows=rows)
    results = read_results(tmp_path)
    assert list(results.played["test"]) == ["langwm"]
    assert score_split(results, "test")["langwm"].average.success.mean == 1
