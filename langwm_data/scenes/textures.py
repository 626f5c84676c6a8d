"""Procedural textures: one picture for each material category and id.

Pictures depend on category and id only, repeat without a seam, and hold little detail finer than a
centimetre, so that renderers without mipmaps show them without much flicker. Which ids a split may show
is the business of ``splits``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes import texture_recipes as draw
from langwm_data.scenes.patterns import Field
from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.splits import CATALOGUE_SIZES
from langwm_data.scenes.texture_cache import kept_picture
from langwm_data.seeding import make_rng

Draw = Callable[[np.random.Generator, int, Field], Field]
"""From a generator, a size in pixels and a base colour to a picture (S, S, 3) in [0, 1]."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How one material category is drawn."""

    tile_m: float
    """Edge of the square that a picture covers, in metres; divides 2."""
    colors: tuple[str, ...]
    """Base colours; ids take them in turn."""
    draw: Draw


def tile_size_m(category: str) -> float:
    """Edge of the square that a texture of ``category`` covers before it repeats, in metres."""
    return RECIPES[category].tile_m


@lru_cache(maxsize=1024)
def texture_image(ref: MaterialRef, size_px: int) -> NDArray[np.uint8]:
    """The texture of one material, (size_px, size_px, 3), not writable; wraps around in both directions.

    Raises:
        ValueError: If there is no such material.
    """
    if not 1 <= ref.id <= CATALOGUE_SIZES.get(ref.category, 0):
        known = CATALOGUE_SIZES.get(ref.category)
        allowed = f"ids 1 to {known}" if known else f"categories {', '.join(CATALOGUE_SIZES)}"
        raise ValueError(f"texture {ref} is unknown; allowed: {allowed}")
    return kept_picture(f"{ref.category}-{ref.id}", size_px, partial(_paint, ref, size_px))


def _paint(ref: MaterialRef, size_px: int) -> NDArray[np.uint8]:
    recipe = RECIPES[ref.category]
    rng = make_rng(0, "texture", ref.category, ref.id)
    turn, place = divmod(ref.id - 1, len(recipe.colors))
    base = draw.color(recipe.colors[place])
    # Later rounds through the same colours are darker, by a step that never repeats.
    base = base * (0.88 + 0.12 * np.cos(2.4 * turn)) + rng.uniform(-0.015, 0.015, 3)
    colors = np.clip(recipe.draw(rng, size_px, np.clip(base, 0.05, 0.92)), 0, 1)
    return (colors * 255).round().astype(np.uint8)


def _recipe(tile_m: float, paint: Draw, colors: str) -> Recipe:
    return Recipe(tile_m=tile_m, draw=paint, colors=tuple(colors.split()))


RECIPES: Mapping[str, Recipe] = MappingProxyType(
    {
        "asphalt": _recipe(1.0, draw.asphalt, "4a4a4c 2f3033 6a6967 5a544e 3d4148"),
        "bricks": _recipe(1.0, draw.bricks, "9c4a36 b5653f d8c3a0 7c3b30 e6e0d6 8d8378 5e4a42"),
        "concrete": _recipe(2.0, draw.concrete, "a5a39e 8a8b8d c2bdb3 6f7072 b3aca0"),
        "fabric": _recipe(
            0.5, draw.fabric, "3f5f8a a33f3d d9cdb8 4f7a55 7b5a86 d69a3c 3a3d44 8fb3c4 c77f8e 6b5844"
        ),
        "fabric_carpet": _recipe(1.0, draw.fabric_carpet, "8c3b3b 3e5573 c9b797 57704f 6e6a68 b07a4a 4d3f5c"),
        "ground": _recipe(1.0, draw.ground, "6b4f37 8a6f4d 4d3c2c a58a63 77664f"),
        "leather": _recipe(0.5, draw.leather, "6a3f26 2b2523 a8703f 7d2a2a e0d3bd 3c4a3a"),
        "marble": _recipe(2.0, draw.marble, "ece9e4 2c2d30 d9c7b0 b9c4bd e3c9c2"),
        "metal": _recipe(1.0, draw.metal, "a9adb2 6c7075 c9a45c b3704c 3a3d42 d4d7d9"),
        "metal_diamond_plate": _recipe(0.5, draw.metal_diamond_plate, "8f9499 5e6266 a98f5a b8bcc0"),
        "moss": _recipe(1.0, draw.moss, "4f6b2c 7a8c3a 355428 93994f"),
        "paint": _recipe(
            2.0,
            draw.paint,
            "f3efe6 dfe6e3 f0dfc0 c9d6df a9b89a ead3cb e9e2a8 d9d6d0 b98f78 cfc3dc 9fb4bd f6f4f0",
        ),
        "paving_stones": _recipe(2.0, draw.paving_stones, "9a958d b08a6f 777a7d c7bba5 8c6a5a"),
        "planks": _recipe(1.0, draw.planks, "a8794a 7d7a74 d8cfc0 5c4433 8fa19d b55f45"),
        "plaster": _recipe(2.0, draw.plaster, "efe8da e2d3b7 d3b79a e9e9e6 c7cdbf d8a98c bcc8cf"),
        "plastic": _recipe(0.5, draw.plastic, "d8433b 2f6fb5 f0c33a ededeb 3a9a5c 2a2c30 ee8a3a 8a4fa0"),
        "porcelain": _recipe(0.5, draw.porcelain, "f5f4f0 e9ecef f1e6d4 d3e3e4"),
        "rocks": _recipe(1.0, draw.rocks, "7d7870 5f5a55 a39078 6d747a"),
        "terrazzo": _recipe(1.0, draw.terrazzo, "e2ddd3 b9bdbd 3f4347 d9b9a4 9fb0a6"),
        "tiles": _recipe(1.0, draw.tiles, "f0eee9 9fc0c7 c98a5e 4f6672 dcd2bd 7f9c82 2f3136 a9b6c9 b5534a"),
        "wood": _recipe(1.0, draw.wood, "c49a66 8a5a34 e0c394 5b3a26 a3683b d1ab82 74492e b98a5e"),
        "wood_floor": _recipe(2.0, draw.wood_floor, "b98752 8b5a36 d9b885 5e3f2b a5714a c7a884 70503a"),
    }
)
"""Colours and sizes. Source: ours."""
