"""The tables of a grid: test floors beside the paper, distances, differences, costs.

Owns which number stands where and how it is rounded.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby

from agent.benchmark.notes import system_notes, table_notes
from agent.benchmark.paper import PAPER_FLOORS, PAPER_PARTS, PAPER_TABLE, PaperRow
from agent.benchmark.results import CellResult, Results
from agent.benchmark.rows import GROUPS, Group, row_of
from agent.benchmark.scores import Score, SystemScores
from agent.benchmark.typeset import Entry, Line, Table
from pretrain.statistics import Interval

NOTHING = Entry("-")

Scores = Mapping[str, SystemScores]


def main_table(results: Results, scores: Scores) -> Table:
    """Success and SPL on every test floor and over all, with the paper's row under each of ours."""
    floors = list(next(iter(scores.values())).floors) if scores else []
    marks = system_notes(results, list(scores))

    def rows(system: str) -> list[Line]:
        found = scores[system]
        entries = [Entry(row_of(system).title), Entry(_seeds(found))]
        for part in [*(found.floors[floor] for floor in floors), found.average]:
            entries += [percent(part.success), number(part.spl, 2)]
        ours = Line(entries=tuple(entries), mark=marks.get(system, ("", ""))[0])
        paper = PAPER_TABLE.get(system)
        return [ours] if paper is None else [ours, _paper_line(paper, floors)]

    notes = [*(("", text) for text in table_notes(results)), *marks.values()]
    return Table(
        title="Test floors: unseen homes, unseen textures",
        columns=("system", "seeds", *["SR %", "SPL"] * (len(floors) + 1)),
        spans=(("", 2), *((_floor_title(floor), 2) for floor in floors), ("average", 2)),
        lines=_grouped(list(scores), rows),
        notes=tuple(notes),
    )


def tier_table(results: Results, scores: Scores, split: str) -> Table:
    """What the distance of the goal does, and measures beside success."""
    edges = results.base.env.distance_edges_m
    tiers = sorted({tier for found in scores.values() for tier in found.tiers})
    names = [f"{edges[tier]:g} to {edges[tier + 1]:g} m" for tier in tiers]

    def rows(system: str) -> list[Line]:
        found = scores[system]
        entries = [Entry(row_of(system).title)]
        for tier in tiers:
            entries += _tier_entries(found.tiers.get(tier))
        average = found.average
        entries += [number(average.distance_to_goal, 2), Entry(f"{100 * average.collision_share:.0f}")]
        return [Line(entries=tuple(entries))]

    counts = {(s.num_seeds, s.num_episodes) for found in scores.values() for s in found.tiers.values()}
    episodes = sorted({episodes for _, episodes in counts})
    return Table(
        title=f"By distance, {split} floors",
        columns=("system", *["SR %", "SPL", "SoftSPL"] * len(tiers), "left, m", "contact, % of steps"),
        spans=(("", 1), *((name, 3) for name in names), ("all distances", 2)),
        lines=_grouped(list(scores), rows),
        notes=(("", f"Episodes of each distance with every seed: {' or '.join(map(str, episodes))}."),),
    )


def difference_table(found: Mapping[str, Mapping[str, Interval]], against: str, split: str) -> Table:
    """Every system minus one of them, on shared episodes."""

    def rows(system: str) -> list[Line]:
        measures = found[system]
        entries = (
            Entry(row_of(system).title),
            percent(measures["success"], sign="+"),
            number(measures["spl"], 3, sign="+"),
            number(measures["soft_spl"], 3, sign="+"),
        )
        return [Line(entries=entries)]

    title = row_of(against).title
    return Table(
        title=f"Minus {title}, {split} floors",
        columns=("system", "SR, percentage points", "SPL", "SoftSPL"),
        lines=_grouped(list(found), rows),
        notes=(
            (
                "",
                f"Positive: better than {title}. Both played the same episodes; seeds are drawn apart,"
                " episodes together. Intervals at 95 % each, not corrected for their number; one of no"
                " width comes from systems that no episode told apart.",
            ),
        ),
    )


def cost_table(results: Results) -> Table:
    """What the cells took."""

    def rows(system: str) -> list[Line]:
        return [Line(entries=(Entry(row_of(system).title), *_costs(results.of(system))))]

    machines = sorted({_machine(r) for r in results.cells if r.record.machine})
    return Table(
        title="What each row cost",
        columns=(
            "system",
            "cells done",
            "training, h",
            "scoring, h",
            "processor, h",
            "environment steps",
            "updates",
            "parameters, M",
        ),
        lines=_grouped(results.systems, rows),
        notes=(
            (
                "",
                "Means of the cells that are done. Processor: of the cell's own process, training and"
                " scoring.",
            ),
            *(("", f"Machine: {text}.") for text in machines),
        ),
    )


def percent(interval: Interval, sign: str = "") -> Entry:
    """A rate in per cent."""
    mean, low, high = (100 * x for x in (interval.mean, interval.low, interval.high))
    return Entry(f"{mean:{sign}.1f}", f"[{low:{sign}.1f}, {high:{sign}.1f}]")


def number(interval: Interval, digits: int, sign: str = "") -> Entry:
    """A mean."""
    form = f"{sign}.{digits}f"
    return Entry(format(interval.mean, form), f"[{interval.low:{form}}, {interval.high:{form}}]")


def _grouped(systems: Sequence[str], rows: Callable[[str], list[Line]]) -> tuple[Line, ...]:
    def group_of(system: str) -> Group:
        return row_of(system).group

    lines = []
    for group, members in groupby(systems, key=group_of):
        lines.append(Line(entries=(Entry(GROUPS[group]),), kind="group"))
        for system in members:
            lines += rows(system)
    return tuple(lines)


def _paper_line(row: PaperRow, floors: Sequence[str]) -> Line:
    entries = [Entry(f"paper: {row.title}"), Entry("")]
    for floor in floors:
        part = PAPER_PARTS.get(floor, floor)
        if part in PAPER_FLOORS:
            place = PAPER_FLOORS.index(part)
            entries += [Entry(f"{row.success_percent[place]:.1f}"), Entry(f"{row.spl[place]:.2f}")]
        else:
            entries += [Entry(""), Entry("")]
    entries += [Entry(f"{row.average_success_percent:.1f}"), Entry(f"{row.average_spl:.2f}")]
    return Line(entries=tuple(entries), kind="cited")


def _floor_title(floor: str) -> str:
    part = PAPER_PARTS.get(floor)
    return floor if part is None else f"{floor} (as {part})"


def _seeds(found: SystemScores) -> str:
    return str(len(found.seeds)) if row_of(found.system).group != "control" else "-"


def _tier_entries(score: Score | None) -> list[Entry]:
    if score is None:
        return [NOTHING] * 3
    return [percent(score.success), number(score.spl, 2), number(score.soft_spl, 2)]


def _costs(cells: Sequence[CellResult]) -> tuple[Entry, ...]:
    done = [result for result in cells if result.record.state == "done"]
    head = Entry(f"{len(done)} of {len(cells)}")
    if not done:
        return (head, *[NOTHING] * 6)
    records = [result.record for result in done]
    hours = [sum(r.seconds.get(part, 0.0) for r in records) / len(done) / 3600 for part in ("train", "score")]
    processor = sum(sum(r.cpu_seconds.values()) for r in records) / len(done) / 3600
    times = [Entry(f"{hours[0]:.2f}"), Entry(f"{hours[1]:.2f}"), Entry(f"{processor:.2f}")]
    config = done[0].config
    if config is None:
        return (head, NOTHING, *times[1:], *[NOTHING] * 3)
    updates = sum(r.updates for r in records) / len(done)
    millions = sum(r.parameters for r in records) / len(done) / 1e6
    return (head, *times, Entry(f"{config.steps:,}"), Entry(f"{updates:,.0f}"), Entry(f"{millions:.2f}"))


def _machine(result: CellResult) -> str:
    machine = result.record.machine
    parts = [
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory_gib']:g} GiB",
        f"{machine['threads']} thread{'s' * (machine['threads'] != 1)} a cell",
        *([machine["gpu"]] if "gpu" in machine else []),
        f"Python {machine['python']}, PyTorch {machine['torch']}",
    ]
    return "; ".join(parts)
