"""What the table says of each system: its title, its place, and where it differs from the others.

Owns words and order. How a system is built stands in the registry; what it was configured to do is read
from its run.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Group = Literal["paper", "ablation", "bound", "control", "other"]

GROUPS: Mapping[Group, str] = MappingProxyType(
    {
        "paper": "systems of the paper",
        "ablation": "without objects or language",
        "bound": "with a detector, or what it could see at best",
        "other": "systems of your own",
        "control": "controls, which learn nothing",
    }
)
"""Parts of the table from top to bottom."""


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """How a system appears."""

    title: str
    group: Group
    note: str = ""
    """Of a control; what is to be said of a learner stands in the registry."""
    needs_download: bool = False
    """Whether it wants weights that do not come with the program: only run when asked for by name."""


TABLE: Mapping[str, TableRow] = MappingProxyType(
    {
        "rad": TableRow(title="RAD", group="paper"),
        "curl": TableRow(title="CURL", group="paper"),
        "dreamerv2": TableRow(title="DreamerV2", group="paper"),
        "dreamerv2-da": TableRow(title="DreamerV2 + DA", group="paper"),
        "mwm": TableRow(title="MWM", group="paper"),
        "langwm": TableRow(title="LanGWM", group="paper"),
        "langwm-empty-language": TableRow(title="LanGWM + object mask, empty language", group="ablation"),
        "langwm-no-mask": TableRow(title="LanGWM, no object mask, with language", group="ablation"),
        "langwm-no-mask-empty-language": TableRow(
            title="LanGWM, no object mask, empty language", group="ablation"
        ),
        "dreamerv2-grounding-dino": TableRow(
            title="DreamerV2 + Grounding DINO", group="bound", needs_download=True
        ),
        "dreamerv2-oracle-boxes": TableRow(title="DreamerV2 + the simulator's boxes", group="bound"),
        "oracle": TableRow(
            title="oracle path follower", group="control", note="Knows the map and the shortest way."
        ),
        "turn-to-goal": TableRow(
            title="turn to goal", group="control", note="Reads the goal's bearing; blind to obstacles."
        ),
        "straight-ahead": TableRow(title="straight ahead", group="control"),
        "random": TableRow(title="random", group="control"),
    }
)
"""In the order of the table."""


def row_of(system: str) -> TableRow:
    """What is said of a system; of one that is not listed, its name."""
    return TABLE.get(system) or TableRow(title=system, group="other")


def in_table_order(systems: set[str]) -> list[str]:
    """By group, then as listed, then by name."""
    groups, listed = list(GROUPS), list(TABLE)

    def key(system: str) -> tuple[int, int, str]:
        place = listed.index(system) if system in TABLE else len(listed)
        return groups.index(row_of(system).group), place, system

    return sorted(systems, key=key)
