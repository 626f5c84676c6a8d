"""Which models homes take: sizes at which a model can be used as what it is called, and what can be shown.

Catalogues also hold chairs for dolls, sofas for lobbies and desks that are a whole wall. A category that is
not in the table stays procedural: windows, doors and curtains are cut to the openings of the house.
"""

from collections.abc import Mapping

import numpy as np

from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.spec import Vec3

Range = tuple[float, float]

SIZES_M: Mapping[str, tuple[Range, Range, Range]] = {
    # seats and beds
    "chair": ((0.35, 0.66), (0.35, 0.70), (0.70, 1.20)),
    "armchair": ((0.50, 1.15), (0.50, 1.00), (0.65, 1.10)),
    "sofa": ((1.20, 2.60), (0.60, 1.10), (0.60, 1.05)),
    "stool": ((0.25, 0.55), (0.25, 0.60), (0.40, 1.10)),
    "bench": ((0.60, 1.50), (0.30, 0.50), (0.35, 0.55)),
    "office_chair": ((0.45, 0.75), (0.45, 0.75), (0.75, 1.25)),
    "pouf": ((0.30, 0.95), (0.30, 0.95), (0.30, 0.65)),
    "bed": ((0.85, 2.10), (1.85, 2.35), (0.40, 1.70)),
    # tables
    "dining_table": ((1.00, 2.40), (0.65, 1.25), (0.70, 0.80)),
    "coffee_table": ((0.60, 1.45), (0.40, 0.80), (0.30, 0.55)),
    "side_table": ((0.30, 0.70), (0.30, 0.70), (0.40, 0.70)),
    "desk": ((0.95, 1.90), (0.50, 0.85), (0.70, 0.80)),
    # storage
    "nightstand": ((0.30, 0.60), (0.30, 0.50), (0.35, 0.70)),
    "bookshelf": ((0.40, 2.60), (0.20, 0.50), (0.70, 2.30)),
    "wardrobe": ((0.80, 2.20), (0.35, 0.70), (1.40, 2.38)),
    "dresser": ((0.50, 1.80), (0.35, 0.65), (0.60, 1.30)),
    "tv_stand": ((1.00, 1.80), (0.30, 0.60), (0.30, 0.70)),
    "coat_rack": ((0.30, 1.30), (0.30, 0.60), (1.20, 1.90)),
    "storage_shelf": ((0.50, 1.20), (0.25, 0.60), (1.00, 2.00)),
    "chest": ((0.50, 1.50), (0.30, 0.60), (0.25, 0.90)),
    # kitchen
    "kitchen_cabinet": ((0.40, 0.65), (0.50, 0.65), (0.80, 0.95)),
    "wall_cabinet": ((0.30, 0.65), (0.25, 0.45), (0.50, 0.80)),
    "kitchen_sink": ((0.50, 0.65), (0.50, 0.65), (0.80, 1.30)),
    "stove": ((0.50, 1.10), (0.50, 0.75), (0.80, 1.00)),
    "fridge": ((0.50, 1.00), (0.50, 0.98), (1.20, 2.00)),
    "range_hood": ((0.50, 0.70), (0.25, 0.60), (0.10, 0.60)),
    "microwave": ((0.35, 0.55), (0.28, 0.45), (0.20, 0.35)),
    "trash_can": ((0.15, 0.50), (0.15, 0.50), (0.20, 0.80)),
    # bathroom
    "toilet": ((0.30, 0.50), (0.50, 0.90), (0.60, 0.95)),
    "washbasin": ((0.40, 1.90), (0.35, 0.80), (0.30, 2.30)),
    "bathtub": ((1.40, 1.90), (0.60, 1.65), (0.40, 1.10)),
    "shower": ((0.70, 1.20), (0.70, 1.20), (1.80, 2.30)),
    "washing_machine": ((0.50, 0.70), (0.50, 0.70), (0.70, 1.00)),
    "laundry_basket": ((0.30, 0.60), (0.30, 0.60), (0.40, 0.80)),
    "towel_rail": ((0.30, 0.80), (0.05, 0.25), (0.08, 0.60)),
    # devices and light
    "tv": ((0.50, 1.30), (0.03, 0.35), (0.30, 0.80)),
    "floor_lamp": ((0.20, 0.70), (0.20, 0.70), (1.20, 2.00)),
    "table_lamp": ((0.10, 0.45), (0.10, 0.45), (0.25, 0.80)),
    "ceiling_lamp": ((0.10, 0.90), (0.10, 0.90), (0.03, 0.70)),
    # on walls and floors
    "radiator": ((0.40, 1.50), (0.05, 0.30), (0.30, 0.80)),
    "rug": ((0.40, 2.50), (0.30, 3.00), (0.001, 0.02)),
    "potted_plant": ((0.25, 1.10), (0.25, 1.10), (0.50, 1.90)),
    "piano": ((1.20, 1.60), (0.50, 1.80), (0.90, 1.80)),
    # things that physics lays down
    "cup": ((0.05, 0.15), (0.05, 0.15), (0.03, 0.16)),
    "bowl": ((0.10, 0.45), (0.10, 0.45), (0.04, 0.25)),
    "bottle": ((0.03, 0.12), (0.03, 0.12), (0.08, 0.36)),
    "book": ((0.10, 0.35), (0.10, 0.35), (0.005, 0.10)),
    "vase": ((0.08, 0.32), (0.08, 0.32), (0.12, 0.55)),
    "cooking_pot": ((0.15, 0.40), (0.15, 0.40), (0.08, 0.32)),
    "ball": ((0.06, 0.30), (0.06, 0.30), (0.06, 0.30)),
    "cardboard_box": ((0.20, 0.85), (0.20, 0.65), (0.15, 0.50)),
    "toy_car": ((0.05, 0.20), (0.10, 0.35), (0.04, 0.20)),
    "shoe": ((0.15, 0.32), (0.20, 0.40), (0.04, 0.30)),
}
"""Least and most width, depth and height."""

HUNG = frozenset({"washbasin", "radiator"})
"""Categories that homes put on the floor and of which some models hang on the wall: those keep the height
that their catalogue states."""

WITH_TOP = frozenset({"dining_table", "desk", "side_table", "nightstand", "tv_stand"})
"""Categories that homes rely on to carry something."""
MIN_TOP_SHARE = 0.45
"""Least part of such a model's footprint that is one level rectangle: a round table has 0.54."""
MIN_TOP_HEIGHT = 0.8
"""Least height of that rectangle, as a share of the model's."""

MAX_CUT_OUT_SHARE = 0.25
"""Of a model's surface may be cut out of its textures: renderers draw triangles in full, so that all of them
show the same, and leaves would be black cards."""

MAX_TRIANGLES = 10_000
"""A model that is still heavier once it is thinned would be a third of its floor."""

_AXES = ("wide", "deep", "high")


def misfit(model: CatalogueModel) -> str | None:
    """Why homes do not take a model, as the end of a sentence, or None."""
    if model.kind is None:
        return "nothing says what it is"
    category = model.kind.category
    if category not in SIZES_M:
        return f"a {category} of a home is procedural"
    for value, (low, high), axis in zip(model.size, SIZES_M[category], _AXES, strict=True):
        if not low <= value <= high:
            return f"{value:.2f} m {axis}; homes take a {category} that is {low:g} to {high:g} m {axis}"
    return None


def has_use(category: str, size: Vec3, top: tuple[float, ...] | None) -> bool:
    """Whether a model can carry what homes put on its category."""
    if category not in WITH_TOP:
        return True
    if top is None:
        return False
    height, x0, y0, x1, y1 = top
    share = (x1 - x0) * (y1 - y0) / float(np.prod(size[:2]))
    return share >= MIN_TOP_SHARE and height >= MIN_TOP_HEIGHT * size[2]
