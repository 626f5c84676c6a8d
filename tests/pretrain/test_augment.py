"""Colour changes against Pillow's and SciPy's; spatial jitter against its meaning."""

import colorsys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageEnhance
from scipy import ndimage

from pretrain import augment
from pretrain.augment import augment_frame, spatial_jitter
from pretrain.config import AugmentConfig
from pretrain.frames import FrameObject

NEVER = AugmentConfig(padding_px=0, color_probability=0.0, grayscale_probability=0.0, blur_probability=0.0)


@pytest.fixture
def rgb():
    """Smooth colours, all of them."""
    y, x = np.mgrid[0:32, 0:48] / 48
    image = np.stack([x, y, 1 - x * y], axis=-1)
    return np.clip(image * 255, 0, 255).astype(np.uint8)


def an_object(box=(10.0, 8.0, 20.0, 18.0), center_x=15.0):
    return FrameObject(category="chair", bbox_xyxy=box, center_x=center_x, distance_m=2.5)


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.4])
@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (augment.adjust_brightness, ImageEnhance.Brightness),
        (augment.adjust_contrast, ImageEnhance.Contrast),
        (augment.adjust_saturation, ImageEnhance.Color),
    ],
)
def test_colours_change_as_in_pillow(rgb, ours, theirs, factor):
    expected = np.asarray(theirs(Image.fromarray(rgb)).enhance(factor)).astype(int)
    assert np.abs(ours(rgb, factor).astype(int) - expected).max() <= 2


@pytest.mark.parametrize("shift", [-0.1, 0.0, 0.05, 0.1, 0.5])
def test_hue_turns_the_colour_circle(rgb, shift):
    changed = augment.adjust_hue(rgb, shift)
    for y, x in [(0, 5), (10, 40), (31, 20), (16, 16)]:
        hue, saturation, value = colorsys.rgb_to_hsv(*(rgb[y, x] / 255))
        expected = np.array(colorsys.hsv_to_rgb((hue + shift) % 1, saturation, value)) * 255
        step = 6  # one of 256 hues: 6 levels of one channel
        assert np.abs(changed[y, x] - expected).max() <= step + 2


def test_grayscale_has_equal_channels(rgb):
    gray = augment_frame(
        np.random.default_rng(0),
        rgb,
        np.ones((32, 48), np.float32),
        [],
        AugmentConfig(padding_px=0, color_probability=0.0, grayscale_probability=1.0, blur_probability=0.0),
    )[0]
    assert (gray == gray[..., :1]).all()
    assert np.abs(gray[..., 0].astype(int) - np.asarray(Image.fromarray(rgb).convert("L"))).max() <= 1


def test_blur_is_a_gaussian_of_the_drawn_sigma():
    noise = np.random.default_rng(0).integers(0, 256, (32, 48, 3), dtype=np.uint8)
    config = AugmentConfig(
        padding_px=0,
        color_probability=0.0,
        grayscale_probability=0.0,
        blur_probability=1.0,
        blur_sigma_px=(1.5, 1.5),
    )
    blurred = augment_frame(np.random.default_rng(1), noise, np.ones((32, 48), np.float32), [], config)[0]
    expected = ndimage.gaussian_filter(noise.astype(float), sigma=(1.5, 1.5, 0), mode="mirror", truncate=3)
    assert np.abs(blurred - expected).max() < 3


def test_probability_zero_changes_nothing(rgb):
    depth = np.random.default_rng(0).random((32, 48), dtype=np.float32)
    objects = [an_object()]
    changed = augment_frame(np.random.default_rng(0), rgb, depth, objects, NEVER)
    assert np.array_equal(changed[0], rgb)
    assert np.array_equal(changed[1], depth)
    assert changed[2] == objects


def test_same_generator_same_bytes(rgb):
    depth = np.ones((32, 48), np.float32)
    first, second = (
        augment_frame(np.random.default_rng(5), rgb, depth, [an_object()], AugmentConfig()) for _ in range(2)
    )
    assert np.array_equal(first[0], second[0])
    assert first[2] == second[2]


@given(seed=st.integers(0, 10_000), padding_px=st.integers(0, 12))
@settings(max_examples=40, deadline=None)
def test_boxes_move_with_the_pixels_they_describe(seed, padding_px):
    depth = np.full((32, 48), 4.0, np.float32)
    depth[8:18, 10:20] = 2.0
    rgb = np.repeat((depth * 50).astype(np.uint8)[..., None], 3, axis=2)
    rng = np.random.default_rng(seed)
    moved_rgb, moved, objects = spatial_jitter(rng, rgb, depth, [an_object()], padding_px)
    (x1, y1, x2, y2), (ys, xs) = objects[0].bbox_xyxy, np.nonzero(moved == 2.0)
    assert (x1, y1, x2, y2) == (xs.min(), ys.min(), xs.max() + 1, ys.max() + 1)
    assert x1 <= objects[0].center_x <= x2
    assert objects[0].distance_m == 2.5
    is_new = moved == 0
    assert np.array_equal(moved_rgb[..., 0][~is_new], (moved * 50).astype(np.uint8)[~is_new])
    assert (moved_rgb[is_new] > 0).all()


def test_objects_that_leave_the_frame_are_dropped():
    edge = an_object(box=(0.0, 0.0, 3.0, 3.0), center_x=1.5)
    kept = set()
    for seed in range(60):
        rgb, depth = np.zeros((32, 48, 3), np.uint8), np.ones((32, 48), np.float32)
        objects = spatial_jitter(np.random.default_rng(seed), rgb, depth, [edge], 10)[2]
        kept.add(len(objects))
        for o in objects:
            x1, y1, x2, y2 = o.bbox_xyxy
            assert 0 <= x1 < x2 <= 48
            assert 0 <= y1 < y2 <= 32
    assert kept == {0, 1}
