"""What a grid is: which systems and seeds, how each cell is configured, where it lies.

Owns the request: what may be asked for, and what is refused before anything is written.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agent.benchmark.rows import TABLE, row_of
from agent.config import AgentConfig
from agent.config.places import absolute, with_absolute_places
from agent.systems.controls import CONTROL_NAMES
from agent.systems.registry import SYSTEMS, load_agent_config, readers_of_mae
from langwm_data.config_io import (
    CONFIG_FILE,
    ConfigError,
    config,
    load_config,
    merge,
    parse_assignment,
    read_mapping,
)
from langwm_data.numbers import PositiveInt

MAE_OF = "langwm"
"""The system that an autoencoder without a name is for; others want ones trained their own way."""
EPISODES = "eval_episodes"
"""The one setting that may grow."""
MOST_SEEDS = 1000
OF_CELLS = {"system": "--systems", "seed": "--seeds", "mae": "--mae"}
"""Settings in which cells differ, and the flags that give them."""


@config
class GridConfig:
    """A grid: cells and episodes may be added, what each cell is trained on may not change."""

    systems: tuple[str, ...]
    seeds: tuple[int, ...]
    presets: tuple[str, ...] = ()
    """Of every agent, later ones win; what makes a system what it is comes after them."""
    overrides: dict[str, Any] = field(default_factory=dict)
    """Flags and assignments put together, in the names of ``AgentConfig``; they win over everything."""
    episodes: PositiveInt | None = None
    """On each test floor; as the presets say when None. There may be more another time, not fewer."""
    mae: dict[str, str] = field(default_factory=dict)
    """Runs of pretrain-mae by the system that reads them."""
    against: str = MAE_OF
    """The system that others are compared with in the tables."""


@dataclass(frozen=True, order=True)
class Cell:
    """One system trained from one seed; controls have the seed 0."""

    system: str
    seed: int

    @property
    def is_control(self) -> bool:
        """Whether nothing is trained."""
        return self.system in CONTROL_NAMES

    @property
    def name(self) -> str:
        """As it is called in sentences; also its folder in that of the grid."""
        return f"{self.system}/seed-{self.seed}"

    def folder(self, out: Path) -> Path:
        """The run of this cell."""
        return out / self.system / f"seed-{self.seed}"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Which cells are asked for, as on the command line."""

    systems: str | None = None
    """Names with commas between; all that need no download when None."""
    seeds: str = "0"
    """As ``parse_seeds`` reads them."""
    mae: Sequence[str] = ()
    """``RUN`` for ``langwm``, or ``SYSTEM=RUN``."""
    against: str = MAE_OF
    """The system that others are compared with."""


def make_grid(
    request: Request,
    *,
    presets: Sequence[str] = (),
    flags: Mapping[str, Any] | None = None,
    assignments: Sequence[str] = (),
) -> GridConfig:
    """The grid that a command line asks for.

    Args:
        request: Which cells.
        presets: Of every agent, later ones win.
        flags: Nested values that win over presets.
        assignments: ``a.b=value``, which win over flags.

    Raises:
        ConfigError: If a system, seed, preset or setting is not allowed.
    """
    overrides = dict(flags or {})
    for text in assignments:
        overrides = merge(overrides, parse_assignment(text))
    overrides = with_absolute_places(overrides)
    episodes = overrides.pop(EPISODES, None)
    for name, flag in OF_CELLS.items():
        if name in overrides:
            raise ConfigError(f"--set {name}={overrides[name]} is not for a grid; give {flag}")
    grid = GridConfig(
        systems=parse_systems(request.systems),
        seeds=parse_seeds(request.seeds),
        presets=tuple(presets),
        overrides=overrides,
        episodes=episodes,
        mae={system: absolute(run) for system, run in parse_maes(request.mae).items()},
        against=check_against(request.against),
    )
    base_config(grid)
    return grid


def known_systems() -> list[str]:
    """Learners and controls, as listed in the table, then others of the registry."""
    found = {*SYSTEMS, *CONTROL_NAMES}
    return [name for name in TABLE if name in found] + sorted(found - set(TABLE))


def parse_systems(text: str | None) -> tuple[str, ...]:
    """``a,b,c`` as names, each once.

    Raises:
        ConfigError: If one of them is unknown, or there is none.
    """
    known = known_systems()
    if text is None:
        return tuple(name for name in known if not row_of(name).needs_download)
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            raise ConfigError(f"--systems: {name!r} is unknown; allowed: {', '.join(known)}")
    if not names:
        raise ConfigError(f"--systems {text!r} names no system; allowed: {', '.join(known)}")
    return tuple(dict.fromkeys(names))


def check_against(system: str) -> str:
    """A system to compare with.

    Raises:
        ConfigError: If it is unknown.
    """
    if system not in known_systems():
        raise ConfigError(f"--against {system!r} is unknown; allowed: {', '.join(known_systems())}")
    return system


def parse_seeds(text: str) -> tuple[int, ...]:
    """``0-4``, ``7`` or ``0-2,5`` as numbers, both ends included.

    Raises:
        ConfigError: If the text is not of that form, or names more than ``MOST_SEEDS``.
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not first <= last < first + MOST_SEEDS:
            raise ConfigError(
                f"--seeds {text!r} is not of the form 0-4, 7 or 0-2,5, first before last,"
                f" at most {MOST_SEEDS} in a row"
            )
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return tuple(seeds)


def parse_maes(texts: Sequence[str]) -> dict[str, str]:
    """``RUN`` or ``SYSTEM=RUN`` as runs by system.

    Raises:
        ConfigError: If the system is unknown, reads no autoencoder, or is named twice.
    """
    runs: dict[str, str] = {}
    readers = [name for name in known_systems() if name in readers_of_mae()]
    for text in texts:
        name, equals, run = text.partition("=")
        if not equals:
            name, run = MAE_OF, text
        if name not in readers or not run:
            raise ConfigError(
                f"--mae {text!r} is not of the form RUN or SYSTEM=RUN; systems that read one:"
                f" {', '.join(readers)}"
            )
        if name in runs:
            raise ConfigError(f"--mae names two runs for {name}: {runs[name]!r} and {run!r}; give one")
        runs[name] = run
    return runs


def cells_of(grid: GridConfig) -> list[Cell]:
    """All cells: controls first, which cost little, then every system with the first seed, and so on."""
    controls = [Cell(system, 0) for system in grid.systems if system in CONTROL_NAMES]
    learners = [s for s in grid.systems if s not in CONTROL_NAMES]
    return controls + [Cell(system, seed) for seed in grid.seeds for system in learners]


def cell_config(grid: GridConfig, cell: Cell) -> AgentConfig:
    """How a learner is trained.

    Raises:
        ConfigError: If a setting is not allowed.
    """
    own: dict[str, Any] = {"seed": cell.seed, "mae": grid.mae.get(cell.system)}
    return load_agent_config(cell.system, presets=grid.presets, overrides=merge(_shared(grid), own))


def base_config(grid: GridConfig) -> AgentConfig:
    """What all cells share: the environment, the episodes, how long.

    Raises:
        ConfigError: If a preset or a setting is not allowed.
    """
    return load_config(AgentConfig, "agent", presets=grid.presets, overrides=_shared(grid))


def _shared(grid: GridConfig) -> dict[str, Any]:
    return grid.overrides if grid.episodes is None else {**grid.overrides, EPISODES: grid.episodes}


def is_grid(out: Path) -> bool:
    """Whether a folder is that of a grid, also of one that was only begun.

    Raises:
        ConfigError: If its configuration is damaged.
    """
    path = out / CONFIG_FILE
    return path.is_file() and {"systems", "seeds"} <= set(read_mapping(path))
