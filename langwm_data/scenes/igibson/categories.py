"""What iGibson calls things, and what we call them.

Captions keep iGibson's words; our categories are for numbers in semantic masks and for what is eligible.
Source: the categories of iGibson 1.0 objects, as far as its public code names them.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

from langwm_data.scenes.taxonomy import UNKNOWN

_NEAREST: Mapping[str, str] = MappingProxyType(
    {
        "bottom_cabinet": "cabinet",
        "bottom_cabinet_no_top": "cabinet",
        "carpet": "rug",
        "cooktop": "stove",
        "grandfather_clock": "clock",
        "heater": "radiator",
        "plant": "potted_plant",
        "shelf": "storage_shelf",
        "sofa_chair": "armchair",
        "speaker_system": "loudspeaker",
        "standing_tv": "tv",
        "top_cabinet": "wall_cabinet",
        "towel_rack": "towel_rail",
        "wall_clock": "clock",
        "wall_mounted_tv": "tv",
        "washer": "washing_machine",
    }
)
_SAME = (
    *("basket", "bathtub", "bed", "bench", "ceiling_lamp", "chair", "chest", "coffee_machine"),
    *("coffee_table", "console_table", "counter", "crib", "cushion", "dishwasher", "door", "dryer"),
    *("fence", "floor_lamp", "fridge", "guitar", "laptop", "loudspeaker", "microwave", "mirror", "monitor"),
    *("office_chair", "oven", "piano", "picture", "pool_table", "range_hood", "shower", "sink", "sofa"),
    *("stool", "stove", "table", "table_lamp", "toilet", "trash_can", "treadmill", "window"),
)

OURS: Mapping[str, str] = MappingProxyType({name: name for name in _SAME} | _NEAREST)
"""Our category for each of theirs that is known."""


def our_category(name: str) -> str:
    """Our category for one of theirs; ``UNKNOWN`` for those that no public code names."""
    return OURS.get(name, UNKNOWN)


def phrase_of(name: str) -> str:
    """The noun that captions use: their name with blanks, in small letters."""
    return " ".join(re.findall("[a-z0-9]+", name.lower())) or "object"
