import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from grid_folders import begin_grid, write_cell

from agent.benchmark.grid import Cell
from agent.benchmark.notes import system_notes
from agent.benchmark.paper import PAPER_FLOORS, PAPER_PARTS, PAPER_TABLE
from agent.benchmark.results import read_results
from agent.benchmark.rows import TABLE
from agent.benchmark.scores import differences, score_split
from agent.benchmark.tables import cost_table, difference_table, main_table, tier_table
from agent.benchmark.typeset import Entry, Line, Table, to_latex, to_markdown
from agent.systems.registry import SYSTEMS
from langwm_data.scenes.splits import BUILDINGS, IGIBSON_BUILDINGS, split_of_scene
from pretrain.statistics import Interval

NASTY = Table(
    title="a | b",
    columns=("name_1", "50 %", "<x>"),
    spans=(("", 1), ("A & B", 2)),
    lines=(
        Line(entries=(Entry("group #1"),), kind="group"),
        Line(entries=(Entry("C:\\x_{y}~^$"), Entry("1.0", "[0.5, 1.5]"), Entry("[2]")), mark="a"),
        Line(entries=(Entry("cited|*row*"), Entry("3"), Entry("")), kind="cited"),
    ),
    notes=(("", "100 % & more_"), ("a", "see <this>")),
)


def as_text(table):
    return [[f"{e.value} {e.interval}".strip() for e in line.entries] for line in table.lines]


@pytest.fixture(scope="module")
def results(finished):
    return read_results(finished)


@pytest.fixture(scope="module")
def main(results):
    return main_table(results, score_split(results, "test"))


def test_the_papers_averages_are_those_of_its_cells_up_to_what_it_rounded():
    for name, row in PAPER_TABLE.items():
        slack = 0.1 if name == "dreamerv2" else 0.05
        assert row.average_success_percent == pytest.approx(np.mean(row.success_percent), abs=slack), name
        # Cells and averages are both rounded to hundredths.
        assert row.average_spl == pytest.approx(np.mean(row.spl), abs=0.0101), name
    assert set(PAPER_TABLE) <= set(TABLE)
    assert (
        max(PAPER_TABLE, key=lambda n: PAPER_TABLE[n].average_success_percent) == "dreamerv2-grounding-dino"
    )


def test_our_test_floors_play_the_parts_of_the_papers():
    ours = [f"{b}_{i}" for b, v in BUILDINGS.items() if v.split == "test" for i in range(v.floors)]
    assert list(PAPER_PARTS) == ours
    assert tuple(PAPER_PARTS.values()) == PAPER_FLOORS
    assert {split_of_scene(name, IGIBSON_BUILDINGS) for name in PAPER_FLOORS} == {"test"}


def test_the_papers_row_stands_under_ours(main):
    rows = as_text(main)
    at = next(i for i, row in enumerate(rows) if row[0] == "LanGWM")
    assert rows[at + 1] == ["paper: LanGWM", "", "8.3", "0.05", "2.1", "0.01", "9.9", "0.06", "6.8", "0.04"]
    assert main.lines[at + 1].kind == "cited"
    assert [text for text, _ in main.spans] == [
        "",
        "Maple_0 (as Ihlen_0)",
        "Maple_1 (as Ihlen_1)",
        "Rowan_0 (as Rs_0)",
        "average",
    ]
    assert sum(count for _, count in main.spans) == len(main.columns)
    assert all(len(line.entries) == len(main.columns) for line in main.lines if line.kind != "group")
    assert [row[0] for row in rows if row[0].startswith("paper")] == ["paper: LanGWM"]


def test_our_numbers_are_those_of_the_episodes(main, results):
    played = results.played["test"]["langwm"]
    wins = played.values["success"][:, played.scene == "Maple_1"]
    row = next(row for row in as_text(main) if row[0] == "LanGWM")
    assert row[1] == "2"
    assert row[4].startswith(f"{100 * wins.mean():.1f} [")
    assert row[-1].startswith(f"{played.values['spl'].mean():.2f} [")


def test_notes_say_what_was_asked_of_the_systems_and_what_is_missing(main, results, tmp_path):
    text = " ".join(text for _, text in main.notes)
    assert "4,000 environment steps" in text
    assert "An update every 5 steps." in text
    assert "has one seed" not in text
    assert "Not finished" not in text
    grid = begin_grid(tmp_path, "langwm", "0-1", mae=["runs/mae"])
    write_cell(tmp_path, grid, Cell("langwm", 0))
    results = read_results(tmp_path)
    half = main_table(results, score_split(results, "test"))
    text = " ".join(text for _, text in half.notes)
    assert "has one seed" in text
    assert (
        "pretrained on rendered frames, beside the environment steps counted here, and is trained on" in text
    )


def test_what_the_registry_says_of_a_system_stands_in_its_note(results, monkeypatch):
    told = replace(SYSTEMS["langwm"], note="our reading: no depth")
    monkeypatch.setitem(SYSTEMS, "langwm", told)
    notes = dict(system_notes(results, ["random", "langwm", "turn-to-goal"]).values())
    assert notes == {
        "a": "Our reading: no depth. An update every 5 steps.",
        "b": "Reads the goal's bearing; blind to obstacles.",
    }


def test_distances_stand_beside_one_another(results):
    table = tier_table(results, score_split(results, "train"), "train")
    assert table.spans == (("", 1), ("1 to 3 m", 3), ("3 to 6 m", 3), ("all distances", 2))
    assert all(len(line.entries) == 9 for line in table.lines if line.kind != "group")
    assert table.notes[0][1] == "Episodes of each distance with every seed: 20."


def test_differences_show_their_sign(results):
    found = differences(results, "test", "langwm")
    table = difference_table(found, "langwm", "test")
    row = next(row for row in as_text(table) if row[0] == "random")
    assert re.fullmatch(r"-\d\d\.\d \[-\d\d\.\d, -\d\d\.\d\]", row[1])
    same = {"random": dict.fromkeys(("success", "spl", "soft_spl"), Interval(0.1, 0.0, 0.2))}
    row = as_text(difference_table(same, "langwm", "test"))[1]
    assert row[1:] == ["+10.0 [+0.0, +20.0]", *["+0.100 [+0.000, +0.200]"] * 2]


def test_costs_are_means_of_cells_that_are_done(results):
    table = cost_table(results)
    rows = {row[0]: row for row in as_text(table)}
    assert rows["LanGWM"] == ["LanGWM", "2 of 2", "0.10", "0.05", "0.15", "4,000", "1,900", "2.50"]
    assert rows["random"] == ["random", "1 of 1", "-", "0.02", "0.02", "-", "-", "-"]
    assert "Abacus 9000, 2 cores, 4 GiB; 1 thread a cell" in table.notes[1][1]


def test_markdown_is_one_table_whatever_stands_in_it():
    lines = to_markdown(NASTY).splitlines()
    assert lines[0] == r"### a \| b"
    rows = [line for line in lines if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {4}
    assert rows[0] == r"| name\_1 | A & B 50 % | A & B \<x\> |"
    assert rows[2] == r"| **group \#1** |  |  |"
    assert rows[3] == r"| C:\\x\_{y}\~^$ [a] | 1.0 [0.5, 1.5] | [2] |"
    assert rows[4] == r"| *cited\|\*row\** | *3* |  |"
    assert lines[-1] == r"[a] see \<this\>"


def test_latex_has_as_many_cells_as_columns_and_escapes_what_it_must(main):
    for table in (NASTY, main):
        lines = to_latex(table).splitlines()
        assert lines[1] == rf"\begin{{tabular}}{{l{'r' * (len(table.columns) - 1)}}}"
        assert lines[-1] == r"\end{tabular}"
        for line in lines[2:-1]:
            if line == r"\hline":
                continue
            assert line.endswith(r" \\")
            spans = [int(n) for n in re.findall(r"\\multicolumn\{(\d+)\}", line)]
            cells = len(re.findall(r"(?<!\\)&", line)) + 1
            assert cells - len(spans) + sum(spans) == len(table.columns)
    text = to_latex(NASTY)
    assert r"C:\textbackslash{}x\_\{y\}\textasciitilde{}\textasciicircum{}\$$^{\mathrm{a}}$" in text
    assert r"\textbf{group \#1}" in text
    assert r"{\scriptsize {[}0.5, 1.5{]}}" in text


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="LaTeX is not installed")
def test_latex_compiles_without_packages(main, tmp_path):
    for name, table in (("nasty", NASTY), ("main", main)):
        page = rf"\documentclass{{article}}\begin{{document}}\input{{{name}-table}}\end{{document}}"
        (tmp_path / f"{name}.tex").write_text(page)
        (tmp_path / f"{name}-table.tex").write_text(to_latex(table))
        command = ["pdflatex", "-halt-on-error", "-interaction=nonstopmode", name]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-2000:]
        assert (tmp_path / f"{name}.pdf").stat().st_size > 1000
