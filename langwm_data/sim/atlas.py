"""All textures in one large picture: where each lies, its mip levels, and how to look it up.

A block holds one texture, its finest level on top, each coarser one, half as large, under it. Every level
has a border of one texel that repeats its other side, so filtering needs no wrapping. The lookup stands
here twice, for NumPy and for the shader. What the picture is made of is the owner's business: see
``gl_device`` and ``render_embree``.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.sim.texture import Texture, texture_picture

WIDTH = 4096
STEPS = 32
"""Steps to a texel in which positions are rounded. Sums of a block's corner and a position in it are then
exact, so a texture looks the same wherever in the picture it lies; and OpenCV's ``remap`` knows no finer."""

Floats = NDArray[np.float32]
Picture = NDArray[np.uint8]
Block = tuple[float, float, float, float]
"""Column, row and size of a texture in texels, and how often it can be halved."""
Write = Callable[[int, int, Picture], None]
"""Puts a picture (h, w, 3) at column x and row y."""

SHADER = f"""
uniform sampler2D atlas;
uniform vec2 atlas_size;

vec3 texel(vec4 block, vec2 tile, float size, float level) {{
    vec2 inside = floor(tile * size * {STEPS}.0 + 0.5) / {STEPS}.0 + 1.0;
    vec2 corner = vec2(block.x, block.y + 2.0 * (block.z - size + level));
    return texture(atlas, (corner + inside) / atlas_size).rgb;
}}

vec3 look_up(vec4 block, vec2 tile, float level) {{
    float clamped = clamp(level, 0.0, block.w - 1.0), below = floor(clamped);
    float size = floor(block.z * exp2(-below) + 0.5);
    vec2 inside = fract(tile);
    vec3 fine = texel(block, inside, size, below);
    return mix(fine, texel(block, inside, 0.5 * size, below + 1.0), clamped - below);
}}
"""


def look_up(picture: Picture, block: Floats, tile: Floats, level: Floats) -> Floats:
    """Colours (3, N), 0 to 255, filtered within a level and between two.

    Args:
        picture: The atlas.
        block: (4, N), column, row, size in texels and number of halvings of each texture.
        tile: (2, N), position on the texture; 1 is once across.
        level: (N,), 0 is the finest.
    """
    clamped = np.clip(level, 0, block[3] - 1)
    below = np.floor(clamped)
    size = np.ldexp(block[2], -below.astype(np.int32)).astype(np.float32, copy=False)
    inside = tile - np.floor(tile)
    fine = _texels(picture, block, inside, size, below)
    coarse = _texels(picture, block, inside, size * np.float32(0.5), below + 1)
    return (fine + (coarse - fine) * (clamped - below)).astype(np.float32, copy=False)


def _texels(picture: Picture, block: Floats, tile: Floats, size: Floats, level: Floats) -> Floats:
    # OpenCV refuses pictures with more than 32767 rows or columns.
    num = len(level)
    rows = -(-num // WIDTH)
    places = np.zeros((2, rows * WIDTH), np.float32)
    # Texel centres lie at .5 in ``tile`` and at whole numbers for OpenCV: the border's 1, less a half.
    inside = np.floor(tile * (size * STEPS) + 0.5) / STEPS + np.float32(0.5)
    np.add(inside[0], block[0], out=places[0, :num])
    np.add(inside[1], block[1] + 2 * (block[2] - size + level), out=places[1, :num])
    x, y = places.reshape(2, rows, WIDTH)
    found = cv2.remap(picture, x, y, cv2.INTER_LINEAR)
    return np.stack([channel.ravel()[:num] for channel in cv2.split(found)], dtype=np.float32)


def texel_density(tile_m: Floats, size: Floats, texture_px: int) -> Floats:
    """(N,), texels to a metre of surface.

    Args:
        tile_m: (N,), metres that one width of a texture covers; 0 for materials of the palette, which have
            ``texture_px`` texels to a metre.
        size: (N,), texels across each texture.
        texture_px: As ``RenderConfig`` has it.
    """
    is_own = tile_m > 0
    return np.where(is_own, size / np.where(is_own, tile_m, 1), np.float32(texture_px)).astype(np.float32)


class Atlas:
    """Gives textures their places; the textures of all scenes and palettes stay until it is full."""

    def __init__(self, texture_px: int, write: Write) -> None:
        self.generation = 0
        """Changes when all places are given up."""
        self._texture_px = texture_px
        self._write = write
        self._blocks: dict[Texture, Block] = {}
        self._shelves: dict[int, tuple[int, int]] = {}
        """By size: column and row where the next texture of that size goes."""
        self._top = 0

    @staticmethod
    def shape(texture_px: int) -> tuple[int, int]:
        """Rows and columns of the picture: room for the whole catalogue, or nearly."""
        return 64 * texture_px, WIDTH

    def place(self, texture: Texture, assets: Assets = NO_ASSETS) -> Block:
        """Where a texture lies; it is drawn when it is first asked for, if need be from ``assets``."""
        if texture not in self._blocks:
            image = texture_picture(texture, assets, self._texture_px)
            size, picture = len(image), _block_picture(image)
            x, y = self._find_place(size, *picture.shape[:2])
            self._write(x, y, picture)
            self._blocks[texture] = (x, y, size, size.bit_length() - 1)
        return self._blocks[texture]

    def known_place(self, texture: Texture) -> Block | None:
        """Where a texture lies, if anyone asked for it before."""
        return self._blocks.get(texture)

    def _find_place(self, size: int, height: int, width: int) -> tuple[int, int]:
        x, y = self._shelves.get(size, (WIDTH, 0))
        if x + width > WIDTH:
            if self._top + height > self.shape(self._texture_px)[0]:
                self._start_over()
            x, y = 0, self._top
            self._top += height
        self._shelves[size] = x + width, y
        return x, y

    def _start_over(self) -> None:
        self.generation += 1
        self._blocks.clear()
        self._shelves.clear()
        self._top = 0


class Blocks:
    """Where the textures of one scene lie in an atlas; each is drawn when it is first needed."""

    def __init__(self, atlas: Atlas, textures: Sequence[Texture], assets: Assets = NO_ASSETS) -> None:
        self.table = np.zeros((len(textures), 4), np.float32)
        """A row for each texture, as ``Atlas.place`` gives it; zeros where nobody asked yet."""
        self._atlas = atlas
        self._textures = textures
        self._assets = assets
        self._has_place = np.zeros(len(textures), np.bool_)
        self._generation = atlas.generation

    def fill_seen(self, numbers: NDArray[np.int32]) -> bool:
        """Fill in the rows of ``numbers``, any number in any shape; whether the table changed.

        If it has to, it takes in all others that have places already: whoever copies the table does so less.
        """
        needed = np.zeros(len(self._textures), np.bool_)
        needed[numbers] = True
        has_changed = False
        while missing := self._missing(needed):
            for number in missing:
                self._fill(number, self._atlas.place(self._textures[number], self._assets))
            has_changed = True
        if has_changed:
            for number in np.flatnonzero(~self._has_place).tolist():
                if (block := self._atlas.known_place(self._textures[number])) is not None:
                    self._fill(number, block)
        return has_changed

    def _fill(self, number: int, block: Block) -> None:
        self.table[number] = block
        self._has_place[number] = True

    def _missing(self, needed: NDArray[np.bool_]) -> list[int]:
        if self._generation != self._atlas.generation:
            self._generation = self._atlas.generation
            self._has_place[:] = False
        return np.flatnonzero(needed & ~self._has_place).tolist()


def _block_picture(texture: Picture) -> Picture:
    """A texture and its mip levels, v upwards, each level with its border."""
    size = len(texture)
    halvings = size.bit_length() - 1
    assert size == 1 << halvings, size
    block = np.zeros((2 * size + 2 * halvings + 1, size + 2, 3), np.uint8)
    level, row = texture[::-1], 0
    for _ in range(halvings + 1):
        edge = len(level) + 2
        block[row : row + edge, :edge] = np.pad(level, ((1, 1), (1, 1), (0, 0)), "wrap")
        row += edge
        if len(level) > 1:
            level = cv2.resize(level, (len(level) // 2,) * 2, interpolation=cv2.INTER_AREA)
    assert row == len(block)
    return block
