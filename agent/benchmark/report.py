"""Writes the tables and the page of a grid from what its cells left; a half-done grid as well.

Owns the files ``table.tex``, ``tables.md`` and ``report.html``, and the sentences at the top of the page.
"""

from collections.abc import Mapping
from pathlib import Path

from agent.benchmark.curves import curves_figure
from agent.benchmark.grid import check_against
from agent.benchmark.results import Played, Results, read_results
from agent.benchmark.rows import row_of
from agent.benchmark.scores import difference, differences, score_split, shared
from agent.benchmark.tables import Scores, cost_table, difference_table, main_table, tier_table
from agent.benchmark.typeset import Table, to_latex, to_markdown
from langwm_data import atomic
from pretrain.page import render_page

LATEX_FILE = "table.tex"
MARKDOWN_FILE = "tables.md"
PAGE_FILE = "report.html"
SPLITS = ("test", "train")
BEATEN = ("random", "straight-ahead")
"""Controls that whoever has learned anything is above."""


def write_reports(out: Path, against: str | None = None) -> Path:
    """Rebuild all three files.

    Args:
        out: Folder of a grid, finished or not.
        against: The system whose numbers are taken from those of the others; the grid's own when None.

    Returns:
        The page.

    Raises:
        ConfigError: If ``out`` holds no grid, or a file of it is damaged.
        ValueError: If seeds of a system were scored on different episodes.
    """
    results = read_results(out)
    against = results.grid.against if against is None else check_against(against)
    scores = {split: score_split(results, split) for split in SPLITS}
    main, tables = main_table(results, scores["test"]), _tables(results, scores, against)
    costs = cost_table(results)
    atomic.write_text(out / LATEX_FILE, to_latex(main))
    atomic.write_text(out / MARKDOWN_FILE, "\n".join(map(to_markdown, [main, *tables, costs])))
    page = render_page(
        "agent",
        "benchmark.html.j2",
        findings=findings(results, scores),
        main=main,
        curves=curves_figure(results),
        tables=tables,
        costs=costs,
        failures=[(r.cell.name, r.record.cause) for r in results.cells if r.record.state == "failed"],
    )
    atomic.write_text(out / PAGE_FILE, page)
    return out / PAGE_FILE


def findings(results: Results, scores: Mapping[str, Scores]) -> list[str]:
    """How far the grid is, who leads on the test floors, and who is above the controls that know nothing."""
    states = [result.record.state for result in results.cells]
    lines = [f"{states.count('done')} of {len(states)} cells are done, {states.count('failed')} failed."]
    learners = [name for name in scores["test"] if row_of(name).group != "control"]
    if learners:
        best = max(learners, key=lambda name: scores["test"][name].average.success.mean)
        rate = 100 * scores["test"][best].average.success.mean
        lines.append(f"Highest success on unseen floors: {row_of(best).title}, {rate:.1f} %.")
    if line := _above_controls(results, scores["train"]):
        lines.append(line)
    return lines


def _above_controls(results: Results, scores: Scores) -> str:
    """Who has learned anything at all: nearest goals, floors that were trained on."""
    learners = [name for name in scores if row_of(name).group != "control" and 0 in scores[name].tiers]
    controls = [name for name in BEATEN if name in scores and 0 in scores[name].tiers]
    if not learners or len(controls) < len(BEATEN):
        return ""
    played = {name: results.played["train"][name] for name in (*learners, *controls)}
    near = {name: own.where(own.tier == 0) for name, own in played.items()}
    bar = max(scores[name].tiers[0].success.mean for name in controls)
    below = [row_of(n).title for n in learners if not all(_is_above(near[n], near[c]) for c in controls)]
    edges = results.base.env.distance_edges_m
    place = f"on training floors, goals {edges[0]:g} to {edges[1]:g} m away"
    count = f"{len(learners) - len(below)} of {len(learners)} learners are shown to succeed more often"
    names = f" (not: {', '.join(below)})" if below else ""
    return f"Learned anything: {count} than random and straight ahead ({100 * bar:.1f} %) {place}{names}."


def _is_above(first: Played, second: Played) -> bool:
    """Whether the whole interval of the difference in success is above 0."""
    both = shared(first, second)
    return both is not None and difference(*both, "success").low > 0


def _tables(results: Results, scores: Mapping[str, Scores], against: str) -> list[Table]:
    tables = [tier_table(results, scores[split], split) for split in SPLITS if scores[split]]
    for split in SPLITS:
        if found := differences(results, split, against):
            tables.append(difference_table(found, against, split))
    return tables
