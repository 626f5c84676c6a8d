"""The numbers of the paper's Table 1, and which of our floors play the parts of its test floors.

Source: Table 1 of Poudel, Pandya, Zhang and Cipolla, "LanGWM: Language Grounded World Model". There,
agents learned for 100k steps in iGibson 1.0; seeds, episodes and intervals are not given.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

PAPER_FLOORS: tuple[str, ...] = ("Ihlen_0", "Ihlen_1", "Rs_0")
"""Test floors in the order of the columns; the paper calls them Ihlen_0_int, Ihlen_1_int and Rs_int."""
PAPER_PARTS: Mapping[str, str] = MappingProxyType(
    {"Maple_0": "Ihlen_0", "Maple_1": "Ihlen_1", "Rowan_0": "Rs_0"}
)
"""Our test floors and the floors whose parts they play: two of one building, one of another."""


@dataclass(frozen=True)
class PaperRow:
    """One row as it is printed."""

    title: str
    success_percent: tuple[float, float, float]
    """On ``PAPER_FLOORS``."""
    spl: tuple[float, float, float]
    average_success_percent: float
    average_spl: float


PAPER_TABLE: Mapping[str, PaperRow] = MappingProxyType(
    {
        "rad": PaperRow("RAD", (0.6, 0.1, 0.8), (0.01, 0.00, 0.01), 0.5, 0.01),
        "curl": PaperRow("CURL", (8.0, 0.6, 5.4), (0.07, 0.01, 0.05), 4.7, 0.04),
        "dreamerv2": PaperRow("DreamerV2", (1.8, 0.6, 1.7), (0.01, 0.00, 0.01), 1.3, 0.01),
        "dreamerv2-da": PaperRow("DreamerV2 + DA", (7.3, 1.6, 7.7), (0.05, 0.01, 0.05), 5.5, 0.04),
        "mwm": PaperRow("MWM", (1.6, 0.5, 2.9), (0.01, 0.00, 0.02), 1.7, 0.01),
        "langwm": PaperRow("LanGWM", (8.3, 2.1, 9.9), (0.05, 0.01, 0.06), 6.8, 0.04),
        "langwm-empty-language": PaperRow(
            "LanGWM + Obj Mask + Empty Lang", (1.6, 0.5, 2.3), (0.01, 0.0, 0.01), 1.5, 0.01
        ),
        "langwm-no-mask-empty-language": PaperRow(
            "LanGWM - Obj Mask + Empty Lang", (1.6, 0.5, 3.0), (0.01, 0.0, 0.02), 1.7, 0.01
        ),
        "dreamerv2-grounding-dino": PaperRow(
            "DreamerV2 + Grounding DINO", (48.9, 17.0, 45.4), (0.45, 0.14, 0.38), 37.1, 0.33
        ),
    }
)
"""By our name of the system. Averages as printed; two of them are not those of the printed cells."""
