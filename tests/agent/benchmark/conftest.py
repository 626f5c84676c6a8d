import pytest
from grid_folders import begin_grid, write_cell

from agent.benchmark.grid import Cell


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A grid of langwm with two seeds and the controls, all done."""
    out = tmp_path_factory.mktemp("grid") / "finished"
    grid = begin_grid(out, "langwm,random,straight-ahead,turn-to-goal")
    for name, rate in {"random": 0.02, "straight-ahead": 0.1, "turn-to-goal": 0.8}.items():
        write_cell(out, grid, Cell(name, 0), rate)
    for seed in (0, 1):
        write_cell(out, grid, Cell("langwm", seed), 0.6)
    return out
