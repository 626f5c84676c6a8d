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
    """What a reader must know to compare it with the others."""
    needs_download: bool = False
    """Whether it wants weights that do not come with the program: only run when asked for by name."""


TABLE: Mapping[str, TableRow] = MappingProxyType(
    {
        "rad": TableRow(
            title="RAD",
            group="paper",
            note="Soft actor-critic on stacked, randomly cropped frames; no depth, no language. Frames are"
            " neither flipped nor turned, which would contradict the goal's bearing.",
        ),
        "curl": TableRow(
            title="CURL",
            group="paper",
            note="Soft actor-critic with a contrastive loss between two random crops; no depth, no language.",
        ),
        "dreamerv2": TableRow(
            title="DreamerV2",
            group="paper",
            note="Reconstructs RGB; no depth, no augmentations, no language.",
        ),
        "dreamerv2-da": TableRow(
            title="DreamerV2 + DA",
            group="paper",
            note="Our reading: the augmentations of Table 2 on what the encoder sees, clean RGB as the"
            " target; no depth, no language.",
        ),
        "mwm": TableRow(
            title="MWM",
            group="paper",
            note="Masked autoencoder of RGB; no depth, no language, no object boxes.",
        ),
        "langwm": TableRow(
            title="LanGWM",
            group="paper",
            note="Masked autoencoder of depth, which learns with the simulator's boxes and captions; acts"
            " with the empty caption and without boxes.",
        ),
        "langwm-empty-language": TableRow(
            title="LanGWM + object mask, empty language",
            group="ablation",
            note="As LanGWM, but its autoencoder only ever reads the empty caption.",
        ),
        "langwm-no-mask": TableRow(
            title="LanGWM, no object mask, with language",
            group="ablation",
            note="As LanGWM without object boxes; the cell that the paper leaves out.",
        ),
        "langwm-no-mask-empty-language": TableRow(
            title="LanGWM, no object mask, empty language",
            group="ablation",
            note="As LanGWM with neither boxes nor captions: a masked autoencoder of depth.",
        ),
        "dreamerv2-grounding-dino": TableRow(
            title="DreamerV2 + Grounding DINO",
            group="bound",
            note="Our reading: the world model sees a frozen detector's pooled features in place of pixels;"
            " the paper gives no detail.",
            needs_download=True,
        ),
        "dreamerv2-oracle-boxes": TableRow(
            title="DreamerV2 + the simulator's boxes",
            group="bound",
            note="Reads the simulator's boxes and categories also while it is tested: what a faultless"
            " detector would tell it.",
        ),
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
