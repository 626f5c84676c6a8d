"""The atlas against textures filtered one texel at a time."""

import numpy as np
import pytest

from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.textures import texture_image
from langwm_data.sim.atlas import STEPS, Atlas, Blocks, look_up

BRICKS, WOOD, PAINT = (MaterialRef.parse(text) for text in ("bricks/01", "wood/02", "paint/03"))


class Memory:
    """An atlas with its picture."""

    def __init__(self, texture_px=16):
        self.picture = np.zeros((*Atlas.shape(texture_px), 3), np.uint8)
        self.atlas = Atlas(texture_px, self.write)

    def write(self, x, y, block):
        area = self.picture[y : y + block.shape[0], x : x + block.shape[1]]
        assert area.shape == block.shape
        assert not area.any(), "blocks overlap"
        area[:] = block


def ask(memory, material, tile, level):
    block = np.float32(memory.atlas.place(material))[:, None].repeat(len(level), 1)
    return look_up(memory.picture, block, np.float32(tile), np.float32(level))


def bilinear(texture, tile):
    """Texel centres at .5, rows from the top, wrapping around."""
    size = len(texture)
    u, v = (np.floor(np.mod(t, 1) * size * STEPS + 0.5) / STEPS - 0.5 for t in tile)
    x, y = int(np.floor(u)), int(np.floor(v))
    total = 0
    for dx, dy in [(0, 0), (1, 0), (0, 1), (1, 1)]:
        weight = (1 - abs(u - x - dx)) * (1 - abs(v - y - dy))
        total = total + weight * texture[::-1][(y + dy) % size, (x + dx) % size].astype(float)
    return total


def halved(texture):
    return texture.reshape(len(texture) // 2, 2, -1, 2, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_level_is_the_texture_halved_and_filtered(level):
    tile = np.random.default_rng(0).uniform(-3, 3, (2, 50))
    found = ask(Memory(), BRICKS, tile, np.full(50, level))
    texture = texture_image(BRICKS, 16)
    for _ in range(level):
        texture = halved(texture)
    expected = np.stack([bilinear(texture, t) for t in tile.T], axis=1)
    np.testing.assert_allclose(found, expected, atol=1.5)


def test_between_levels_colours_are_mixed():
    tile = np.full((2, 3), 0.3)
    low, between, high = ask(Memory(), BRICKS, tile, [1, 1.25, 2]).T
    np.testing.assert_allclose(between, 0.75 * low + 0.25 * high, atol=1e-3)


def test_levels_end_at_two_texels_and_at_the_texture_itself():
    tile = np.full((2, 4), 0.3)
    a, b, c, d = ask(Memory(), BRICKS, tile, [-5, 0, 3, 20]).T
    assert np.array_equal(a, b)
    assert np.array_equal(c, d)


def test_a_texture_looks_the_same_wherever_it_lies():
    rng = np.random.default_rng(1)
    tile, level = rng.uniform(-9, 9, (2, 500)), rng.uniform(0, 4, 500)
    first, later = Memory(), Memory()
    for number in range(1, 41):
        later.atlas.place(MaterialRef(category="tiles", id=number))
        later.atlas.place(MaterialRef(category="wood_floor", id=min(number, 32)))
    assert first.atlas.place(WOOD) != later.atlas.place(WOOD)
    assert np.array_equal(ask(first, WOOD, tile, level), ask(later, WOOD, tile, level))


def test_only_what_is_needed_is_drawn_and_only_once():
    drawn = []
    blocks = Blocks(Atlas(16, lambda x, y, block: drawn.append(block.shape)), (BRICKS, WOOD, BRICKS))
    assert blocks.fill_seen(np.array([[0, 2], [2, 0]]))
    assert len(drawn) == 1
    assert not blocks.fill_seen(np.array([0]))
    assert (blocks.table[0] == blocks.table[2]).all()
    assert not blocks.table[1].any()


def test_a_full_atlas_starts_over(monkeypatch):
    monkeypatch.setattr(Atlas, "shape", staticmethod(lambda texture_px: (80, 4096)))
    picture = np.zeros((80, 4096, 3), np.uint8)

    def write(x, y, block):
        picture[y : y + block.shape[0], x : x + block.shape[1]] = block

    atlas = Atlas(16, write)
    blocks = Blocks(atlas, (BRICKS, PAINT))
    blocks.fill_seen(np.array([0]))
    blocks.fill_seen(np.array([1]))
    assert atlas.generation == 1
    blocks.fill_seen(np.array([0]))
    where = [int(v) for v in blocks.table[0, :2]]
    corner = picture[where[1] + 1 : where[1] + 17, where[0] + 1 : where[0] + 17]
    assert np.array_equal(corner, texture_image(BRICKS, 16)[::-1])
