"""Furniture by name: ``build_model("chair_03")`` always gives the same parts.

Owns which recipe draws which category. Where a piece stands is ``furnishing``'s business.
"""

import functools

from langwm_data.scenes.furniture import (
    bathroom,
    decor,
    devices,
    kitchen,
    openings,
    seating,
    storage,
    tables,
)
from langwm_data.scenes.furniture.model import Builder, Model, Top
from langwm_data.scenes.taxonomy import CATEGORIES
from langwm_data.seeding import make_rng

__all__ = ["Model", "Top", "build_model", "model_names"]

_RECIPES = (
    seating.RECIPES
    | tables.RECIPES
    | storage.RECIPES
    | kitchen.RECIPES
    | bathroom.RECIPES
    | devices.RECIPES
    | decor.RECIPES
)
_MODEL_SEED = 0
"""Models do not depend on a user's seed: a name means the same thing in every dataset."""


def model_names(category: str) -> tuple[str, ...]:
    """All variants of a category: ``chair_01``, ``chair_02``, ..."""
    return tuple(f"{category}_{i:02d}" for i in range(1, CATEGORIES[category].num_models + 1))


@functools.cache
def build_model(name: str) -> Model:
    """The model called ``name``.

    Raises:
        ValueError: If there is no such model.
    """
    category, _, number = name.rpartition("_")
    if category not in CATEGORIES or name not in model_names(category):
        raise ValueError(f"furniture model {name!r} is unknown; names look like 'chair_03'")
    builder = Builder(make_rng(_MODEL_SEED, "model", name))
    if category in openings.RECIPES:
        openings.RECIPES[category](builder, int(number))
    else:
        _RECIPES[category](builder)
    return builder.build(name, category)
