"""From episodes to the numbers of the tables: rates, means and differences with their intervals.

Owns which interval is taken of what: a bootstrap over seeds and the episodes that all of them played, for
differences those that both systems played; of a success rate never narrower than Wilson's.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agent.benchmark.results import Played, Results
from agent.scoring.statistics import seeds_interval, seeds_rate_interval, shared_episodes_interval
from langwm_data.seeding import make_rng
from pretrain.statistics import Interval

COMPARED = ("success", "spl", "soft_spl")
"""Measures whose differences are shown."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """How one system did on some of the episodes."""

    num_episodes: int
    """With each seed."""
    num_seeds: int
    success: Interval
    spl: Interval
    soft_spl: Interval
    distance_to_goal: Interval
    collision_share: float
    """Of steps in contact with something."""


@dataclass(frozen=True, kw_only=True)
class SystemScores:
    """One system on one split."""

    system: str
    seeds: tuple[int, ...]
    floors: Mapping[str, Score]
    average: Score
    tiers: Mapping[int, Score]
    """By distance tier."""


def score_system(played: Played, split: str) -> SystemScores:
    """All scores of one system on one split."""
    floors = {name: played.where(played.scene == name) for name in sorted(set(played.scene.tolist()))}
    tiers = {tier: played.where(played.tier == tier) for tier in sorted(set(played.tier.tolist()))}
    return SystemScores(
        system=played.system,
        seeds=played.seeds,
        floors={name: _score(part, split, name) for name, part in floors.items()},
        average=_score(played, split, "all"),
        tiers={tier: _score(part, split, f"tier {tier}") for tier, part in tiers.items()},
    )


def score_split(results: Results, split: str) -> dict[str, SystemScores]:
    """All systems that were scored on a split, in the order of the table."""
    return {name: score_system(played, split) for name, played in results.played[split].items()}


def differences(results: Results, split: str, against: str) -> dict[str, dict[str, Interval]]:
    """Every other system minus ``against``, by measure, on the episodes that both played."""
    played = results.played[split]
    reference = played.get(against)
    if reference is None:
        return {}
    pairs = {name: both for name in played if name != against and (both := shared(played[name], reference))}
    return {
        name: {measure: difference(*both, measure) for measure in COMPARED} for name, both in pairs.items()
    }


def difference(first: Played, second: Played, measure: str) -> Interval:
    """Mean of one system minus that of another; both played the same episodes (see ``shared``)."""
    rng = make_rng(0, "benchmark difference", first.system, second.system, measure)
    return shared_episodes_interval(first.values[measure], second.values[measure], rng)


def shared(first: Played, second: Played) -> tuple[Played, Played] | None:
    """Both on the episodes that both played; None where there are none."""
    keep = [np.isin(a.task, b.task) for a, b in ((first, second), (second, first))]
    return (first.where(keep[0]), second.where(keep[1])) if keep[0].any() else None


def _score(played: Played, split: str, part: str) -> Score:
    def interval(measure: str) -> Interval:
        rng = make_rng(0, "benchmark", played.system, split, part, measure)
        of_seeds = seeds_rate_interval if measure == "success" else seeds_interval
        return of_seeds(played.values[measure], rng)

    values = played.values
    return Score(
        num_episodes=values["success"].shape[1],
        num_seeds=len(played.seeds),
        success=interval("success"),
        spl=interval("spl"),
        soft_spl=interval("soft_spl"),
        distance_to_goal=interval("distance_to_goal"),
        collision_share=float(values["collisions"].sum() / max(values["length"].sum(), 1)),
    )
