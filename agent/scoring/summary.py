"""From rows of episodes to scores with intervals, and to differences between systems on shared episodes."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.special import bdtr

from agent.scoring.rows import Row
from agent.scoring.statistics import seeds_interval, seeds_rate_interval, wilson_interval
from langwm_data.seeding import make_rng
from pretrain.statistics import Interval, percentiles

MEANS = (
    "spl",
    "soft_spl",
    "distance_to_goal",
    "path_length",
    "collisions",
    "collision_rate",
    "length",
    "return",
)
"""Columns whose mean is reported with a bootstrap interval; success has Wilson's."""
COMPARED = (
    "success",
    "spl",
    "soft_spl",
    "distance_to_goal",
)
"""Columns whose paired differences are reported; success first."""
RESAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Score:
    """How one system did in one group of episodes."""

    system: str
    split: str
    tier: int | None = None
    """None: all distances together."""
    scene: str | None = None
    """None: all floors together."""
    num_episodes: int
    success: Interval
    means: Mapping[str, Interval]

    @property
    def is_overall(self) -> bool:
        """Whether it is of all episodes of a split."""
        return self.tier is None and self.scene is None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, every measure beside the others."""
        head = {"system": self.system, "split": self.split, "tier": self.tier, "scene": self.scene}
        measures = {"success": self.success, **self.means}
        return (
            head
            | {"episodes": self.num_episodes}
            | {name: asdict(interval) for name, interval in measures.items()}
        )


@dataclass(frozen=True, kw_only=True)
class Difference:
    """The first of two systems minus the second, on the episodes that both played."""

    first: str
    second: str
    split: str
    num_episodes: int
    only_first: int
    """Episodes in which the first alone succeeded."""
    only_second: int
    p_value: float
    """Of McNemar's exact test: that success is as likely for both."""
    means: Mapping[str, Interval]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Summary:
    """Scores of all systems, and how the first differs from the others."""

    scores: tuple[Score, ...]
    differences: tuple[Difference, ...] = field(default=())

    def as_text(self) -> str:
        """Tables for a terminal; intervals at 95 %."""
        width = max([16, *(len(s.system) + 2 for s in self.scores)])
        lines = [
            f"{'system':<{width}}{'floors':<8}{'n':>5}  {'success %':<20}{'SPL':<20}{'SoftSPL':<20}to goal, m"
        ]
        for score in self.scores:
            if score.is_overall:
                cells = [score.success.as_text(1, 100.0)]
                cells += [score.means[k].as_text(2) for k in ("spl", "soft_spl", "distance_to_goal")]
                head = f"{score.system:<{width}}{score.split:<8}{score.num_episodes:>5}  "
                lines.append(head + "".join(f"{cell:<20}" for cell in cells).rstrip())
        return "\n".join([*lines, *self._parts(width), *self._differences()])

    def _parts(self, width: int) -> list[str]:
        """Success rates by distance and by floor, a line for each system."""
        parts = sorted(
            {("" if s.scene is None else s.scene, s.tier) for s in self.scores if not s.is_overall},
            key=lambda p: (p[0], -1 if p[1] is None else p[1]),
        )
        if len(parts) < 3:
            return []
        titles = [f"tier {tier}" if tier is not None else scene for scene, tier in parts]
        lines = ["", f"{'success % of':<{width + 8}}" + "".join(f"{title:>10}" for title in titles)]
        for overall in (s for s in self.scores if s.is_overall):
            own = {
                (s.scene or "", s.tier): s
                for s in self.scores
                if (s.system, s.split) == (overall.system, overall.split)
            }
            cells = [
                f"{100 * own[part].success.mean:>10.1f}" if part in own else f"{'':>10}" for part in parts
            ]
            lines.append(f"{overall.system:<{width}}{overall.split:<8}" + "".join(cells))
        return lines

    def _differences(self) -> list[str]:
        lines = []
        for d in self.differences:
            success, spl = d.means["success"], d.means["spl"]
            lines.append(
                f"{d.first} - {d.second}: success {success.as_text(1, 100.0)} points"
                f" (McNemar p = {d.p_value:.3g}), SPL {spl.as_text(2)},"
                f" n = {d.num_episodes}, {d.split}"
            )
        return ["", "on the same episodes:", *lines] if lines else []


def summarise(rows: Sequence[Row]) -> Summary:
    """Scores per system and split: of all episodes, per tier and per floor."""
    groups: dict[tuple[str, str, int | None, str | None], list[Row]] = {}
    for row in rows:
        for tier, scene in ((None, None), (row["tier"], None), (None, row["scene"])):
            groups.setdefault((row["system"], row["split"], tier, scene), []).append(row)
    in_order = sorted(groups, key=lambda g: (g[1], g[3] or "", g[2] is not None, g[2] or 0))
    return Summary(tuple(_score(*group, groups[group]) for group in in_order))


def compare(rows: Sequence[Row], first: str, second: str) -> list[Difference]:
    """How ``first`` differs from ``second`` on the episodes of each split that both played."""
    of = {name: _by_episode(r for r in rows if r["system"] == name) for name in (first, second)}
    shared = sorted(set(of[first]) & set(of[second]))
    found = []
    for split in sorted({key[0] for key in shared}):
        keys = [key for key in shared if key[0] == split]
        a, b = (np.array([[of[n][k][m] for m in COMPARED] for k in keys], float) for n in (first, second))
        only_first, only_second = int((a > b)[:, 0].sum()), int((a < b)[:, 0].sum())
        rng = make_rng(0, "difference", first, second, split)
        found.append(
            Difference(
                first=first,
                second=second,
                split=split,
                num_episodes=len(keys),
                only_first=only_first,
                only_second=only_second,
                p_value=mcnemar_exact(only_first, only_second),
                means=dict(zip(COMPARED, _mean_intervals(a - b, rng), strict=True)),
            )
        )
    return found


def mcnemar_exact(only_first: int, only_second: int) -> float:
    """Two-sided p-value that two systems succeed equally often, from the episodes that told them apart.

    Source: McNemar (1947), with the binomial distribution in place of its approximation.
    """
    fewer = min(only_first, only_second)
    return min(1.0, 2 * float(bdtr(fewer, only_first + only_second, 0.5)))


def pool_runs(rows: Sequence[Row], runs: Mapping[str, str]) -> list[Score]:
    """Scores of systems that several runs were trained of, on the episodes that all of them played.

    Intervals are over runs and episodes.

    Args:
        rows: Under ``system`` they have the names of the runs.
        runs: The system of each run.
    """
    scores = []
    for system in sorted(set(runs.values())):
        names = [name for name, of in runs.items() if of == system]
        for split in sorted({row["split"] for row in rows}) if len(names) > 1 else ():
            own = [_by_episode(r for r in rows if (r["system"], r["split"]) == (n, split)) for n in names]
            shared = sorted(set.intersection(*(set(run) for run in own)))
            rng = make_rng(0, "pooled", system, split)
            columns = {
                m: np.array([[run[k][m] for k in shared] for run in own], float) for m in ("success", *MEANS)
            }
            scores.append(
                Score(
                    system=f"{system}, {len(names)} runs",
                    split=split,
                    num_episodes=len(own) * len(shared),
                    success=seeds_rate_interval(columns["success"], rng),
                    means={m: seeds_interval(columns[m], rng) for m in MEANS},
                )
            )
    return scores


def _by_episode(rows: Iterable[Row]) -> dict[tuple[str, str, int, str], Row]:
    return {(r["split"], r["scene"], r["episode"], r.get("task") or ""): r for r in rows}


def _score(system: str, split: str, tier: int | None, scene: str | None, rows: Sequence[Row]) -> Score:
    rng = make_rng(0, "bootstrap", system, split, -1 if tier is None else tier, scene or "")
    columns = np.array([[row[name] for name in MEANS] for row in rows], dtype=np.float64)
    return Score(
        system=system,
        split=split,
        tier=tier,
        scene=scene,
        num_episodes=len(rows),
        success=wilson_interval(sum(row["success"] for row in rows), len(rows)),
        means=dict(zip(MEANS, _mean_intervals(columns, rng), strict=True)),
    )


def _mean_intervals(columns: Float64[np.ndarray, "N K"], rng: np.random.Generator) -> list[Interval]:
    """Bootstrap intervals of the means of several columns, whose rows are drawn together."""
    num = len(columns)
    means = []
    for _ in range(10):  # some at a time, so that memory stays small
        counts = rng.multinomial(num, np.full(num, 1 / num), size=RESAMPLES // 10)
        means.append(counts @ columns / num)
    resampled = np.concatenate(means)
    return [percentiles(float(column.mean()), resampled[:, k], 0.95) for k, column in enumerate(columns.T)]
