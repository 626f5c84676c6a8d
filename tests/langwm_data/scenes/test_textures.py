"""Textures: the same every time, seamless, told apart, and calm enough to be drawn without mipmaps."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from langwm_data.scenes.patterns import bond, grid, noise, stones
from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.splits import CATALOGUE_SIZES, MATERIAL_CATEGORIES
from langwm_data.scenes.textures import RECIPES, texture_image, tile_size_m

SIZE = 64


def picture(category, number, size=SIZE):
    return texture_image(MaterialRef(category=category, id=number), size)


def shrunk(image, to=8):
    step = len(image) // to
    return image.reshape(to, step, to, step, 3).mean(axis=(1, 3))


def test_every_material_category_has_a_recipe():
    assert tuple(RECIPES) == MATERIAL_CATEGORIES


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_pictures_are_rgb_bytes_of_the_size_asked_for(category):
    for size in (32, 100):
        image = picture(category, 1, size)
        assert image.dtype == np.uint8
        assert image.shape == (size, size, 3)


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_textures_wrap_around_without_a_seam(category):
    # Across the border, neighbours differ no more than they do at the roughest place inside.
    for number in range(1, 6):
        image = picture(category, number).astype(int)
        for axis in (0, 1):
            steps = np.abs(np.diff(image, axis=axis, append=image.take([0], axis=axis)))
            per_line = steps.mean(axis=(1 - axis, 2))
            assert per_line[-1] <= 1.15 * per_line[:-1].max() + 1, (number, axis)


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_ids_of_a_category_look_different(category):
    ids = range(1, CATALOGUE_SIZES[category] + 1)
    small = np.stack([shrunk(picture(category, i, 32)) for i in ids])
    apart = np.abs(small[:, None] - small[None]).mean(axis=(2, 3, 4))
    apart[np.diag_indices(len(apart))] = np.inf
    assert apart.min() > 2.0


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_colours_are_not_washed_out(category):
    for number in (1, 2, 3):
        image = picture(category, number)
        assert (image.min(axis=2) == 255).mean() < 0.05
        assert (image.max(axis=2) == 0).mean() < 0.05


def test_another_process_draws_the_same_bytes():
    names = [("wood", 5), ("terrazzo", 1), ("fabric", 28)]
    here = hashlib.sha256(b"".join(picture(c, i).tobytes() for c, i in names)).hexdigest()
    code = (
        "import hashlib; from langwm_data.scenes.textures import texture_image as t;"
        "from langwm_data.scenes.spec import MaterialRef as M;"
        f"data = b''.join(t(M(category=c, id=i), {SIZE}).tobytes() for c, i in {names});"
        "print(hashlib.sha256(data).hexdigest())"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert there.stdout.strip() == here


def test_a_cached_picture_cannot_be_spoiled():
    with pytest.raises(ValueError, match="read-only"):
        picture("wood", 1)[0, 0] = 0


@pytest.mark.parametrize("category", MATERIAL_CATEGORIES)
def test_tiles_divide_two_metres(category):
    assert (2.0 / tile_size_m(category)).is_integer()


@pytest.mark.parametrize(
    ("category", "number", "message"),
    [
        ("wood", 0, "texture wood/00 is unknown; allowed: ids 1 to 36"),
        ("wood", 37, "texture wood/37 is unknown; allowed: ids 1 to 36"),
        ("gold", 1, "texture gold/01 is unknown; allowed: categories asphalt, bricks"),
    ],
)
def test_unknown_textures_are_refused(category, number, message):
    with pytest.raises(ValueError, match=message):
        picture(category, number)


def test_noise_shows_the_same_field_at_any_size():
    coarse, fine = (noise(np.random.default_rng(4), size, (1, 6)) for size in (32, 96))
    np.testing.assert_allclose(coarse, fine[::3, ::3], atol=0.05)
    assert abs(fine.mean()) < 1e-9
    assert fine.std() == pytest.approx(1)


def test_noise_keeps_to_its_band():
    power = np.abs(np.fft.rfft2(noise(np.random.default_rng(1), 64, (5, 12))))
    frequency = np.hypot(np.fft.fftfreq(64, 1 / 64)[:, None], np.arange(33)[None])
    assert power[(frequency < 5) | (frequency > 12)].max() < 1e-9 * power.max()


def test_bond_numbers_each_block_once():
    u, v = grid(60)
    cells = bond(u, v, 3, 2, np.array([0.0, 0.5, 0.0]))
    assert np.unique(cells.index, return_counts=True)[1].tolist() == [600] * 6
    assert cells.edge.max() <= 1 / 6 + 1e-9


def test_stones_agree_with_a_search_over_all_points():
    u, v = grid(24)
    cells = stones(np.random.default_rng(2), u, v, 4)
    rng = np.random.default_rng(2)
    corner = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
    points = (corner + rng.uniform(0.05, 0.95, corner.shape)) / 4
    offset = np.stack([u, v], axis=-1)[..., None, :] - points
    distance = np.linalg.norm(offset - np.round(offset), axis=-1)
    np.testing.assert_array_equal(cells.index, distance.argmin(axis=-1))
