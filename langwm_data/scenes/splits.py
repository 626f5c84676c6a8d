"""What is kept for testing: buildings and texture ids, and the check that nothing leaks.

Owns Tables 4 and 5. Names of buildings are invented; their shape (five buildings with twelve floors to
train, two with three floors to test) and the held-out texture ids are the paper's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from langwm_data.scenes.spec import MaterialRef, MaterialSlot, SceneSpec, Split


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


def split_of_scene(name: str) -> Split:
    """The split of the floor called ``<building>_<floor>``.

    Raises:
        ValueError: If there is no such floor.
    """
    building, _, floor = name.rpartition("_")
    known = BUILDINGS.get(building)
    if known is None or floor not in {str(i) for i in range(known.floors)}:
        allowed = ", ".join(
            f"{b}_0..{v.floors - 1}" if v.floors > 1 else f"{b}_0" for b, v in BUILDINGS.items()
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
    palette = []
    for slot in slots:
        category = slot.categories[rng.integers(len(slot.categories))]
        choices = _choices(category, split, tuple(pictures))
        palette.append(choices[rng.integers(len(choices))])
    return tuple(palette)


@lru_cache(maxsize=1024)
def _choices(category: str, split: Split, pictures: tuple[MaterialRef, ...]) -> tuple[MaterialRef, ...]:
    if not pictures:
        return tuple(MaterialRef(category=category, id=i) for i in texture_ids(category, split))
    return tuple(m for m in pictures if m.category == category and is_for(m, split))


def is_for(material: MaterialRef, split: Split) -> bool:
    """Whether ``split`` may show a material: held-out ids are for test, all others for training.

    A category of pictures of which nothing is held out (Table 5 lists 22 of iGibson's 28) is for both.
    """
    if not material.picture:
        return material.id in texture_ids(material.category, split)
    held_out = HELD_OUT_TEXTURE_IDS.get(material.category, ())
    return not held_out or (material.id in held_out) == (split == "test")


def check_palette(scene: SceneSpec) -> None:
    """Refuse a scene that shows what its split must not show.

    Raises:
        ValueError: If a known building is given to the other split, or a slot holds a texture that
            is not for the scene's split or not of a category that the slot allows.
    """
    building = BUILDINGS.get(scene.building)
    if building is not None and building.split != scene.split:
        raise ValueError(
            f"scene {scene.name!r} is marked {scene.split}; building {scene.building} is for {building.split}"
        )
    for slot, material in zip(scene.slots, scene.palette, strict=True):
        if material.category not in slot.categories:
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material};"
                f" allowed categories: {', '.join(slot.categories)}"
            )
        if scene.pictures and material not in scene.pictures:
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material}, none of its pictures"
            )
        if not is_for(material, scene.split):
            raise ValueError(
                f"scene {scene.name!r}: slot {slot.name!r} holds texture {material},"
                f" which is not for the {scene.split} split"
            )


def check_models(scene: SceneSpec) -> None:
    """Refuse a scene in which models of others stand that its split must not show.

    Raises:
        ValueError: If a model of the other split is recorded in it.
    """
    for record in scene.models:
        if record.split != scene.split:
            raise ValueError(
                f"scene {scene.name!r} is for {scene.split}; model {record.model!r} of {record.source!r}"
                f" is for {record.split}"
            )
