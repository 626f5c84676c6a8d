import re

import numpy as np
import pytest
from grid_folders import begin_grid, write_cell

from agent.benchmark.curves import band, bin_edges, binned_means, curves_figure
from agent.benchmark.grid import Cell
from agent.benchmark.record import Record, record_path, write_record
from agent.benchmark.report import write_reports
from agent.benchmark.results import read_results
from agent.benchmark.scores import score_split
from langwm_data.config_io import ConfigError


def test_the_page_stands_alone_and_shows_the_tables(finished):
    page = write_reports(finished).read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "<script" not in page
    assert page.count("<table") == 6
    assert "paper: LanGWM" in page
    assert "5 of 5 cells are done, 0 failed." in page
    assert "1 of 1 learners are shown to succeed more often than random and straight ahead" in page
    assert "What failed" not in page


def test_files_are_rebuilt_to_the_same_bytes_from_what_cells_left(finished):
    write_reports(finished)
    files = [finished / name for name in ("report.html", "tables.md", "table.tex")]
    before = [file.read_bytes() for file in files]
    for file in files:
        file.unlink()
    write_reports(finished)
    assert [file.read_bytes() for file in files] == before


def test_another_system_can_be_compared_with(finished):
    write_reports(finished, "turn-to-goal")
    assert "### Minus turn to goal, test floors" in (finished / "tables.md").read_text()
    with pytest.raises(ConfigError, match="--against 'hal' is unknown"):
        write_reports(finished, "hal")


def test_an_empty_grid_and_a_half_done_one_have_tables(tmp_path):
    grid = begin_grid(tmp_path, "langwm,random")
    assert "0 of 0 cells are done" in write_reports(tmp_path).read_text()
    write_cell(tmp_path, grid, Cell("random", 0), 0.0)
    record = Record(state="failed", cause="training diverged: <loss> is not a number")
    write_cell(tmp_path, grid, Cell("langwm", 0), rows=[], record=record, steps=2000)
    page = write_reports(tmp_path).read_text()
    assert "1 of 2 cells are done, 1 failed." in page
    assert "<code>langwm/seed-0</code> training diverged: &lt;loss&gt; is not a number" in page
    assert "How they learned" in page
    assert (
        "Not finished, and counted as far as scored: langwm/seed-0." in (tmp_path / "tables.md").read_text()
    )


def test_a_learner_hardly_above_a_control_has_not_been_shown_to_learn(tmp_path):
    grid = begin_grid(tmp_path, "langwm,random,straight-ahead", "0")
    for name in ("random", "straight-ahead"):
        write_cell(tmp_path, grid, Cell(name, 0), 0.3)
    write_cell(tmp_path, grid, Cell("langwm", 0), 0.5)
    scores = score_split(read_results(tmp_path), "train")
    near = {name: found.tiers[0].success.mean for name, found in scores.items()}
    assert near["langwm"] > max(near["random"], near["straight-ahead"])
    assert "0 of 1 learners are shown to succeed more often" in write_reports(tmp_path).read_text()


def test_a_learner_below_a_control_is_named(tmp_path):
    grid = begin_grid(tmp_path, "langwm,random,straight-ahead", "0")
    for name, rate in {"random": 0.3, "straight-ahead": 0.3}.items():
        write_cell(tmp_path, grid, Cell(name, 0), rate)
    write_cell(tmp_path, grid, Cell("langwm", 0), 0.0)
    assert "0 of 1 learners are shown to succeed more often" in write_reports(tmp_path).read_text()
    assert "(not: LanGWM)" in (tmp_path / "report.html").read_text()


def test_a_folder_without_a_grid_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="holds no grid; give the --out of a benchmark"):
        write_reports(tmp_path)
    (tmp_path / "config.yaml").write_text("[")
    with pytest.raises(ConfigError, match=r"config\.yaml is damaged: it is not YAML"):
        write_reports(tmp_path)


def test_a_damaged_record_is_one_sentence(tmp_path):
    grid = begin_grid(tmp_path, "langwm")
    cell = Cell("langwm", 0)
    write_cell(tmp_path, grid, cell)
    for text in ("{", '{"state": "done", "colour": 1}', "[]"):
        record_path(tmp_path, cell).write_text(text)
        with pytest.raises(
            ConfigError, match=r"seed-0\.json is damaged; remove it, and the cell is looked at"
        ):
            write_reports(tmp_path)


def test_damaged_episodes_are_one_sentence(tmp_path):
    grid = begin_grid(tmp_path, "random")
    write_cell(tmp_path, grid, Cell("random", 0))
    (tmp_path / "random/seed-0/eval/episodes.parquet").write_bytes(b"PAR1")
    with pytest.raises(
        ConfigError, match=r"episodes\.parquet is damaged; remove .*seed-0\.json to score again"
    ):
        write_reports(tmp_path)


def test_curves_are_means_of_what_ended_in_a_stretch():
    rows = [{"step": s, "env/return": v} for s, v in ((5, 1.0), (10, 3.0), (11, 7.0), (30, 9.0))]
    rows += [{"step": 8, "wm/kl": 99.0}, {"step": 9, "env/return": None}]
    means = binned_means(rows, "env/return", np.array([0.0, 10.0, 20.0, 30.0]))
    np.testing.assert_array_equal(means, [2.0, 7.0, 9.0])
    assert np.isnan(binned_means(rows[:2], "env/return", np.array([0.0, 10.0, 20.0]))[1])


def test_bands_reach_from_the_lowest_seed_to_the_highest(tmp_path):
    grid = begin_grid(tmp_path, "langwm", "0-2")
    for seed in range(3):
        write_cell(tmp_path, grid, Cell("langwm", seed), steps=4000 if seed else 2000)
    cells = read_results(tmp_path).of("langwm")
    edges = bin_edges(4000)
    found = band("x", cells, "env/return", edges)
    each = np.array([binned_means(cell.metrics, "env/return", edges) for cell in cells])
    assert len(edges) == 6
    np.testing.assert_allclose(found.middle, np.nanmean(each, axis=0))
    np.testing.assert_allclose(found.low, np.nanmin(each, axis=0))
    np.testing.assert_allclose(found.high, np.nanmax(each, axis=0))
    assert np.isnan(each[0, -1])
    nothing = band("x", cells, "env/unknown", edges)
    assert np.isnan(nothing.middle).all()
    assert np.isnan(nothing.low).all()


def test_without_learners_there_are_no_curves(tmp_path):
    grid = begin_grid(tmp_path, "random")
    write_cell(tmp_path, grid, Cell("random", 0))
    assert curves_figure(read_results(tmp_path)) is None
    assert "How they learned" not in write_reports(tmp_path).read_text()


def test_a_cell_that_has_only_begun_is_in_no_table_of_scores(tmp_path):
    begin_grid(tmp_path, "langwm")
    write_record(tmp_path, Cell("langwm", 0), Record())
    write_reports(tmp_path)
    text = (tmp_path / "tables.md").read_text()
    assert "| LanGWM | 0 of 1 | - |" in text
    assert "paper: LanGWM" not in text
