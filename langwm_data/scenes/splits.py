"""What is kept for testing: buildings and texture ids, and the check that nothing leaks.

Owns Tables 4 and 5: iGibson's buildings, and of our own homes, whose names are invented, the same shape
(five buildings with twelve floors to train, two with three floors to test); held-out texture ids for both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

import numpy as np

from langwm_data.scenes.spec import MaterialRef, MaterialSlot, SceneSpec, Split

HeldOut = Literal["buildings", "textures", "models"]
EVERYTHING: tuple[HeldOut, ...] = ("buildings", "textures", "models")
"""What test frames show that training frames do not, unless a dataset says otherwise. Of models, those of
catalogues: buildings of both splits choose from the same procedural furniture."""


def describe_held_out(holds_out: Sequence[HeldOut]) -> str:
    """``unseen buildings and furniture``, or ``nothing unseen but views``."""
    names = [{"models": "furniture"}.get(what, what) for what in holds_out]
    if not names:
        return "nothing unseen but views"
    *some, last = names
    return f"unseen {', '.join(some)} and {last}" if some else f"unseen {last}"


def side_of(split: Split, what: HeldOut, holds_out: Sequence[HeldOut] = EVERYTHING) -> Split:
    """Whose buildings, textures or models the frames of ``split`` show.

    Args:
        split: Of the frames.
        what: Of which kind.
        holds_out: The kinds that test frames do not share with training frames.
    """
    return split if what in holds_out else "train"


@dataclass(frozen=True, kw_only=True)
class Building:
    """One building: which split it belongs to and how many floors it has."""

    split: Split
    floors: int


BUILDINGS: Mapping[str, Building] = MappingProxyType(
    {
        "Alder": Building(split="train", floors=2),
        "Birch": Building(split="train", floors=3),
        "Cedar": Building(split="train", floors=2),
        "Elm": Building(split="train", floors=3),
        "Hazel": Building(split="train", floors=2),
        "Maple": Building(split="test", floors=2),
        "Rowan": Building(split="test", floors=1),
    }
)
"""Source: Table 4 (numbers of buildings and floors); names ours."""

IGIBSON_BUILDINGS: Mapping[str, Building] = MappingProxyType(
    {
        "Beechwood": Building(split="train", floors=2),
        "Benevolence": Building(split="train", floors=3),
        "Merom": Building(split="train", floors=2),
        "Pomaria": Building(split="train", floors=3),
        "Wainscott": Building(split="train", floors=2),
        "Ihlen": Building(split="test", floors=2),
        "Rs": Building(split="test", floors=1),
    }
)
"""Source: Table 4. Its Rs_int has no number of a floor; here it is ``Rs_0``."""

ALL_BUILDINGS: Mapping[str, Building] = MappingProxyType({**BUILDINGS, **IGIBSON_BUILDINGS})

HELD_OUT_TEXTURE_IDS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        "asphalt": (6, 15),
        "bricks": (8, 19),
        "concrete": (6, 15, 17),
        "fabric": (1, 2, 28),
        "fabric_carpet": (2, 5, 13),
        "ground": (13, 19),
        "leather": (3, 12),
        "marble": (2, 3),
        "metal": (10, 19),
        "metal_diamond_plate": (4,),
        "moss": (1, 3),
        "paint": (5,),
        "paving_stones": (24, 38),
        "planks": (7, 9, 16),
        "plaster": (3,),
        "plastic": (4, 5),
        "porcelain": (2, 4),
        "rocks": (4,),
        "terrazzo": (6, 8),
        "tiles": (43, 49),
        "wood": (2, 5, 16, 22, 32),
        "wood_floor": (6, 10, 17, 28),
    }
)
"""Texture ids used in test only; all other ids are for training. Source: Table 5."""

MATERIAL_CATEGORIES: tuple[str, ...] = tuple(HELD_OUT_TEXTURE_IDS)

CATALOGUE_SIZES: Mapping[str, int] = MappingProxyType(
    {
        "asphalt": 18,
        "bricks": 22,
        "concrete": 20,
        "fabric": 32,
        "fabric_carpet": 16,
        "ground": 22,
        "leather": 14,
        "marble": 10,
        "metal": 22,
        "metal_diamond_plate": 8,
        "moss": 8,
        "paint": 12,
        "paving_stones": 40,
        "planks": 20,
        "plaster": 12,
        "plastic": 10,
        "porcelain": 8,
        "rocks": 8,
        "terrazzo": 12,
        "tiles": 52,
        "wood": 36,
        "wood_floor": 32,
    }
)
"""Each category has the texture ids 1 to this number. Source: ours."""


def split_of_scene(name: str, buildings: Mapping[str, Building] = BUILDINGS) -> Split:
    """The split of the floor called ``<building>_<floor>``.

    Args:
        name: Of the floor.
        buildings: Where it is looked up.

    Raises:
        ValueError: If there is no such floor.
    """
    building, _, floor = name.rpartition("_")
    known = buildings.get(building)
    if known is None or floor not in {str(i) for i in range(known.floors)}:
        allowed = ", ".join(
            f"{b}_0..{v.floors - 1}" if v.floors > 1 else f"{b}_0" for b, v in buildings.items()
        )
        raise ValueError(f"scene {name!r} is unknown; allowed: {allowed}")
    return known.split


def texture_ids(category: str, split: Split) -> tuple[int, ...]:
    """Ids of the textures of ``category`` that ``split`` may show; the two splits share none.

    Raises:
        ValueError: If there is no such material category.
    """
    if category not in HELD_OUT_TEXTURE_IDS:
        raise ValueError(
            f"material category {category!r} is unknown; allowed: {', '.join(MATERIAL_CATEGORIES)}"
        )
    held_out = HELD_OUT_TEXTURE_IDS[category]
    if split == "test":
        return held_out
    return tuple(i for i in range(1, CATALOGUE_SIZES[category] + 1) if i not in held_out)


def sample_palette(
    rng: np.random.Generator,
    slots: Sequence[MaterialSlot],
    split: Split,
    pictures: Sequence[MaterialRef] = (),
) -> tuple[MaterialRef, ...]:
    """One material of ``split`` for every slot: a uniform category, then a uniform id within it.

    Args:
        rng: Draws them.
        slots: What they are for.
        split: Whose textures.
        pictures: What to choose from; if there are none, the procedural textures.

    Source: iGibson 1.0 materials.py (uniform class, then uniform instance).
    """
    palette, choices = [], {}
    for slot in slots:
        category = slot.categories[rng.integers(len(slot.categories))]
        if category not in choices:
            choices[category] = _choices(category, split, tuple(pictures))
        palette.append(choices[category][rng.integers(len(choices[category]))])
    return tuple(palette)


@lru_cache(maxsize=1024)
def _choices(category: str, split: Split, pictures: tuple[MaterialRef, ...]) -> tuple[MaterialRef, ...]:
    if not pictures:
        return tuple(MaterialRef(category=category, id=i) for i in texture_ids(category, split))
    return tuple(m for m in pictures if m.category == category and is_for(m, split))


def is_for(material: MaterialRef, split: Split) -> bool:
    """Whether ``split`` may show a material: held-out ids are for test, all others for training."""
    if not material.picture:
        return material.id in texture_ids(material.category, split)
    return is_picture_for(material.category, material.id, split)


def is_picture_for(category: str, number: int, split: Split) -> bool:
    """The same for a texture that is a picture.

    Table 5 lists 22 of iGibson's 28 categories; the others are for both splits.
    """
    return is_shared(category) or (number in HELD_OUT_TEXTURE_IDS[category]) == (split == "test")


def is_shared(category: str) -> bool:
    """Whether pictures of a category are for both splits, as Table 5 does not list it."""
    return category not in HELD_OUT_TEXTURE_IDS


def check_palette(scene: SceneSpec, holds_out: Sequence[HeldOut] = EVERYTHING) -> None:
    """Refuse a scene that shows what its split must not show.

    Args:
        scene: With its textures.
        holds_out: See ``side_of``.

    Raises:
        ValueError: If a known building is given to the other split, or a slot holds a texture that
            is not for the scene's split or not of a category that the slot allows.
    """
    building = ALL_BUILDINGS.get(scene.building)
    if building is not None and building.split != side_of(scene.split, "buildings", holds_out):
        raise ValueError(
            f"scene {scene.name!r} is marked {scene.split}; building {scene.building} is for {building.split}"
        )
    pictures, side = set(scene.pictures), side_of(scene.split, "textures", holds_out)
    for slot, material in zip(scene.slots, scene.palette, strict=True):
        if material.category not in slot.categories:
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material};"
                f" allowed categories: {', '.join(slot.categories)}"
            )
        if pictures and material not in pictures:
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material}, none of its pictures"
            )
        if not is_for(material, side):
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material},"
                f" which is not for the {side} split"
            )


def check_models(scene: SceneSpec, holds_out: Sequence[HeldOut] = EVERYTHING) -> None:
    """Refuse a scene in which models of others stand that its split must not show.

    A training scene shows no model that is for test. A test scene shows either none but these, or, where
    nothing is held out, as of iGibson, models for training.

    Args:
        scene: With the records of its models.
        holds_out: See ``side_of``; where it is not everything, test scenes show one kind of models only.

    Raises:
        ValueError: If a model of the other split is recorded in it.
    """
    side = side_of(scene.split, "models", holds_out)
    is_strict = tuple(holds_out) != EVERYTHING or any(record.split == "test" for record in scene.models)
    for record in scene.models:
        if is_strict and record.split != side:
            raise ValueError(
                f"scene {scene.name!r} is for {scene.split}; model {record.model!r} of {record.source!r}"
                f" is for {record.split}"
            )
