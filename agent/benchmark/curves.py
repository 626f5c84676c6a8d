"""Learning curves: what training episodes brought over environment steps, seeds as bands."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agent.benchmark.grid import MAE_OF
from agent.benchmark.results import CellResult, Results
from agent.benchmark.rows import row_of
from agent.figures import Band, band_figure

MEASURES = {"success": "env/success", "SoftSPL": "env/soft_spl", "return": "env/return"}
"""Titles of the panels and keys of ``metrics.jsonl``."""
STEPS_PER_BIN = 1000
FEWEST_BINS, MOST_BINS = 5, 40


def curves_figure(results: Results) -> str | None:
    """One panel for each measure, one band for each learner; None where nothing has learned yet."""
    learners = [system for system in results.systems if any(r.metrics for r in results.of(system))]
    if not learners:
        return None
    learners.sort(key=lambda system: system != MAE_OF)
    edges = bin_edges(results.base.steps)
    panels = {
        title: [band(row_of(system).title, results.of(system), key, edges) for system in learners]
        for title, key in MEASURES.items()
    }
    return band_figure(panels, "environment steps")


def bin_edges(steps: int) -> np.ndarray:
    """Limits of the stretches of training that a point of a curve is the mean of."""
    count = int(np.clip(steps // STEPS_PER_BIN, FEWEST_BINS, MOST_BINS))
    return np.linspace(0, steps, count + 1)


def band(name: str, cells: Sequence[CellResult], key: str, edges: np.ndarray) -> Band:
    """Mean over seeds of the means of each stretch, from the lowest seed to the highest.

    A stretch in which no episode of any seed ended is not a number.
    """
    values = np.array([binned_means(cell.metrics, key, edges) for cell in cells])
    known = ~np.isnan(values)
    count = known.sum(axis=0)
    middle = np.full(len(edges) - 1, np.nan)
    np.divide(np.where(known, values, 0.0).sum(axis=0), count, out=middle, where=count > 0)
    low = np.where(known, values, np.inf).min(axis=0)
    high = np.where(known, values, -np.inf).max(axis=0)
    low[count == 0] = high[count == 0] = np.nan
    return Band(name=name, steps=(edges[:-1] + edges[1:]) / 2, middle=middle, low=low, high=high)


def binned_means(metrics: Sequence[Any], key: str, edges: np.ndarray) -> np.ndarray:
    """Means of a logged value in each stretch (edges included at its end); not a number in empty ones."""
    rows = [(row["step"], row[key]) for row in metrics if row.get(key) is not None]
    steps = np.array([step for step, _ in rows], dtype=np.float64)
    values = np.array([value for _, value in rows], dtype=np.float64)
    place = np.searchsorted(edges, steps, side="left") - 1
    count = np.bincount(np.clip(place, 0, None), minlength=len(edges) - 1)[: len(edges) - 1]
    sums = np.bincount(np.clip(place, 0, None), weights=values, minlength=len(edges) - 1)[: len(edges) - 1]
    means = np.full(len(edges) - 1, np.nan)
    np.divide(sums, count, out=means, where=count > 0)
    return means
