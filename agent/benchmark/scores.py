"""From episodes to the numbers of the tables: rates, means and differences with their intervals.

Owns which interval is taken of what: Wilson's for a success rate on one floor, a bootstrap over episodes
for a mean on one floor, a bootstrap over seeds and then episodes for what goes over floors (of a rate never
narrower than Wilson's), and one over seeds and shared episodes for differences between systems.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from agent.benchmark.results import Played, Results
from agent.scoring.statistics import (
    hierarchical_bootstrap_interval,
    pooled_rate_interval,
    shared_episodes_interval,
    wilson_interval,
)
from langwm_data.seeding import make_rng
from pretrain.statistics import Interval, bootstrap_interval

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
        floors={name: _floor_score(part, split, name) for name, part in floors.items()},
        average=_wide_score(played, split, "all"),
        tiers={tier: _wide_score(part, split, f"tier {tier}") for tier, part in tiers.items()},
    )


def score_split(results: Results, split: str) -> dict[str, SystemScores]:
    """All systems that were scored on a split, in the order of the table."""
    return {name: score_system(played, split) for name, played in results.played[split].items()}


def differences(results: Results, split: str, against: str) -> dict[str, dict[str, Interval]]:
    """Every other system minus ``against``, by measure; only where both played the same episodes."""
    played = results.played[split]
    reference = played.get(against)
    if reference is None:
        return {}
    return {
        name: {measure: difference(other, reference, measure) for measure in COMPARED}
        for name, other in played.items()
        if name != against and _are_shared(other, reference)
    }


def difference(first: Played, second: Played, measure: str) -> Interval:
    """Mean of one system minus that of another on the episodes that both played."""
    rng = make_rng(0, "benchmark difference", first.system, second.system, measure)
    return shared_episodes_interval(first.values[measure], second.values[measure], rng)


def _are_shared(first: Played, second: Played) -> bool:
    return np.array_equal(first.scene, second.scene) and np.array_equal(first.episode, second.episode)


def _floor_score(played: Played, split: str, floor: str) -> Score:
    """Seeds are pooled: the interval is of these trained agents, whatever others would do."""

    def interval(measure: str) -> Interval:
        values = played.values[measure].ravel()
        if measure == "success":
            return wilson_interval(int(values.sum()), values.size)
        rng = make_rng(0, "benchmark floor", played.system, split, floor, measure)
        return bootstrap_interval(values, rng, resamples=1000)

    return _score(played, interval)


def _wide_score(played: Played, split: str, part: str) -> Score:
    def interval(measure: str) -> Interval:
        rng = make_rng(0, "benchmark", played.system, split, part, measure)
        over_seeds = pooled_rate_interval if measure == "success" else hierarchical_bootstrap_interval
        return over_seeds(list(played.values[measure]), rng)

    return _score(played, interval)


def _score(played: Played, interval: Callable[[str], Interval]) -> Score:
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
