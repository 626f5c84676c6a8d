"""From instance masks to semantic masks: every category has a number that never changes.

Owns the numbers. Which categories there are, and what they are called, stands in ``scenes.taxonomy``.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.taxonomy import CATEGORIES, FOREIGN_CATEGORIES, STRUCTURE

_NUMBERED = (
    *("wall", "floor", "ceiling"),
    *("chair", "armchair", "sofa", "stool", "bench", "office_chair", "pouf", "bed"),
    *("dining_table", "coffee_table", "side_table", "desk", "console_table"),
    *("nightstand", "bookshelf", "wardrobe", "dresser", "sideboard", "tv_stand", "shoe_rack", "coat_rack"),
    *("storage_shelf", "chest", "kitchen_cabinet", "wall_cabinet", "kitchen_sink", "stove", "fridge"),
    *("dishwasher", "range_hood", "microwave", "trash_can", "toilet", "washbasin", "bathtub", "shower"),
    *("mirror", "washing_machine", "laundry_basket", "towel_rail", "tv", "monitor", "keyboard"),
    *("floor_lamp", "table_lamp", "ceiling_lamp", "picture", "curtain", "radiator", "rug"),
    *("potted_plant", "piano", "window", "door", "door_frame"),
    *("cup", "bowl", "bottle", "book", "vase", "cooking_pot", "ball", "cardboard_box", "toy_car", "shoe"),
    *(
        "basket",
        "cabinet",
        "clock",
        "coffee_machine",
        "counter",
        "crib",
        "cushion",
        "dryer",
        "fence",
        "guitar",
    ),
    *("laptop", "loudspeaker", "oven", "pool_table", "sink", "table", "treadmill", "other_object"),
)
"""In the order of their numbers. New categories go to the end, whatever their place in the taxonomy:
masks and exports that people have keep their meaning."""

CATEGORY_IDS: Mapping[str, int] = MappingProxyType({name: n for n, name in enumerate(_NUMBERED, start=1)})
"""Category to its number in semantic masks and COCO files; 0 is the background."""

assert CATEGORY_IDS.keys() == {*STRUCTURE, *CATEGORIES, *FOREIGN_CATEGORIES}, (
    "every category of the taxonomy has a number"
)
assert len(_NUMBERED) <= np.iinfo(np.uint8).max, "semantic masks have eight bits"


def semantic_mask(
    instance: NDArray[np.uint16], categories: Mapping[int, str], category_ids: Mapping[str, int]
) -> NDArray[np.uint8]:
    """The number of each pixel's category, 0 = background.

    Args:
        instance: (H, W), 0 = background.
        categories: Category of each instance in the mask.
        category_ids: ``CATEGORY_IDS``, or what the manifest of a dataset gives.
    """
    id_of_instance = np.zeros(int(instance.max()) + 1, np.uint8)
    for number, category in categories.items():
        if number < len(id_of_instance):
            id_of_instance[number] = category_ids[category]
    return id_of_instance[instance]
