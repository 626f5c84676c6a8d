"""What a texture is to the renderers: a material of the palette, or one that a mesh brings along.

Owns how large the picture of each is, in texels, and where it comes from.
"""

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.assets import Assets
from langwm_data.scenes.meshes.images import image_size, square_picture
from langwm_data.scenes.meshes.triangles import Material
from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.textures import texture_image, tile_size_m

PICTURE_TILE_M = 1.0
"""Edge of the square that a material covers whose texture is a picture. Source: ours (ADR-0011)."""
FLAT_PX = 2
"""Texels of a material of one colour."""

Texture = MaterialRef | Material
Picture = NDArray[np.uint8]


def texture_tile_m(material: MaterialRef) -> float:
    """Edge of the square that a material of the palette covers before it repeats, in metres."""
    return PICTURE_TILE_M if material.picture else tile_size_m(material.category)


def texture_picture(texture: Texture, assets: Assets, texture_px: int) -> Picture:
    """A square (S, S, 3) whose edge is a power of two, which repeats in both directions.

    Args:
        texture: Which one.
        assets: Where pictures lie.
        texture_px: Pixels to a metre of surface, a power of two; own textures of meshes, of which nobody
            knows how many metres they cover, have at most twice as many pixels along an edge.

    Raises:
        ValueError: If its picture is missing or damaged.
    """
    if isinstance(texture, MaterialRef):
        size = round(texture_tile_m(texture) * texture_px)
        return assets.picture(texture.picture, size) if texture.picture else texture_image(texture, size)
    if texture.texture is None:
        color = np.rint(np.array(texture.color) * 255).astype(np.uint8)
        return np.broadcast_to(color, (FLAT_PX, FLAT_PX, 3))
    label = "the texture of a mesh"
    longest = max(image_size(texture.texture, label))
    size = max(min(1 << (longest - 1).bit_length(), 2 * texture_px), FLAT_PX)
    return square_picture(texture.texture, size, label)
