import colorsys

import cv2
import numpy as np
import pytest
import torch

from agent.config import SACConfig
from agent.models.augmentation import (
    central_view,
    color_jitter,
    cutout,
    hsv_to_rgb,
    random_crop,
    random_grayscale,
    random_pair,
    random_view,
    rgb_to_hsv,
    translate,
    view_size,
)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def coordinates(batch, stack, height, width):
    """Frames whose red and green say where a pixel is, and whose blue which frame it is of."""
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    frames = torch.zeros(batch, stack, height, width, 3, dtype=torch.uint8)
    frames[..., 0], frames[..., 1] = rows, columns
    frames[..., 2] = torch.arange(batch * stack).reshape(batch, stack, 1, 1)
    return frames


def config(*names, **values):
    return SACConfig(data_augs=names, **values)


def test_sizes_are_those_of_the_public_code_and_of_the_notes():
    assert view_size(config("crop"), 100, 100) == (84, 84)
    assert view_size(config("translate"), 100, 100) == (108, 108)
    assert view_size(config("crop"), 128, 160) == (108, 136)
    assert view_size(config("pad_crop"), 128, 160) == (128, 160)
    assert view_size(config("grayscale"), 128, 160) == (128, 160)
    assert view_size(config("crop"), 16, 18) == (16, 16)


def test_a_crop_is_a_window_and_the_same_for_the_whole_stack():
    frames = coordinates(40, 3, 20, 24)
    windows = random_crop(frames, (16, 12), generator())
    assert windows.shape == (40, 3, 16, 12, 3)
    corners = windows[:, 0, 0, 0, :2].long()
    for row, (y, x) in enumerate(corners.tolist()):
        assert torch.equal(windows[row], frames[row, :, y : y + 16, x : x + 12])
    for axis, room in ((0, 4), (1, 12)):
        assert set(corners[:, axis].tolist()) <= set(range(room + 1))
        assert {0, room} <= set(corners[:, axis].tolist())


def test_a_padded_crop_repeats_the_edge_and_keeps_the_size():
    frames = coordinates(60, 2, 20, 24)
    view, _ = random_view(frames, config("pad_crop", padding_px=5), generator())
    assert view.shape == (60, 2, 3, 20, 24)
    rows = (view[:, 0, 0, :, 0] * 255).round().long()
    shift = rows[:, 10] - 10
    expected = (torch.arange(20) + shift[:, None]).clamp(0, 19)
    inner = shift.abs() <= 5
    assert inner.all()
    assert torch.equal(rows, expected)
    assert {-5, 5} <= set(shift.tolist())


def test_translation_moves_the_whole_frame_over_black():
    frames = coordinates(30, 3, 8, 8) + 1
    canvas, places = translate(frames, (12, 16), generator(), None)
    for row, (y, x) in enumerate(places.tolist()):
        assert torch.equal(canvas[row, :, y : y + 8, x : x + 8], frames[row])
    assert int((canvas.sum(-1) > 0).sum()) == 30 * 3 * 8 * 8


def offsets(view):
    return (view[:, 0, :2, 0, 0] * 255).round().long()


def test_both_ends_of_a_transition_are_cropped_apart_and_translated_together():
    frames = coordinates(50, 3, 40, 40)
    seen, following = random_pair(frames, frames, config("crop"), generator())
    assert not torch.equal(offsets(seen), offsets(following))
    seen, following = random_pair(frames, frames, config("translate"), generator())
    assert torch.equal(seen, following)
    another, _ = random_view(frames, config("translate"), generator(1))
    assert not torch.equal(seen, another)


def test_without_augmentation_frames_stay_as_they_are():
    frames = coordinates(2, 3, 8, 8)
    view, places = random_view(frames, config(), generator())
    assert places is None
    torch.testing.assert_close(view * 255, frames.permute(0, 1, 4, 2, 3).float())


@pytest.mark.parametrize(
    ("name", "corner", "size"), [("crop", (8, 8), (84, 84)), ("translate", (-4, -4), (108, 108))]
)
def test_acting_looks_at_the_middle(name, corner, size):
    frames = coordinates(1, 3, 100, 100)
    view = central_view(frames, config(name))
    assert view.shape[-2:] == size
    middle = (view[0, 0, :2, 50, 60] * 255).round().long().tolist()
    assert middle == [50 + corner[0], 60 + corner[1]]


def test_gray_is_opencvs_and_as_frequent_as_asked():
    torch.manual_seed(0)
    pixels = torch.rand(1000, 2, 3, 2, 2)
    gray = random_grayscale(pixels, 0.3, generator())
    is_gray = (gray[:, :, 0] == gray[:, :, 2]).flatten(1).all(1)
    assert is_gray.float().mean().item() == pytest.approx(0.3, abs=0.05)
    assert torch.equal(gray[~is_gray], pixels[~is_gray])
    row = int(is_gray.nonzero()[0])
    expected = cv2.cvtColor(pixels[row, 1].permute(1, 2, 0).numpy().copy(), cv2.COLOR_RGB2GRAY)
    np.testing.assert_allclose(gray[row, 1, 0], expected, atol=1e-3)


def test_a_cutout_is_one_black_box_in_all_frames_of_a_stack():
    pixels = torch.ones(200, 3, 3, 84, 84)
    is_black = cutout(pixels, generator())[:, :, 0] == 0
    assert torch.equal(is_black[:, 0], is_black[:, 2])
    heights, widths = is_black[:, 0].any(2).sum(1), is_black[:, 0].any(1).sum(1)
    assert torch.equal(is_black[:, 0].sum((1, 2)), heights * widths)
    for edges in (heights, widths):
        assert 9 <= int(edges.min()) <= 12
        assert 28 <= int(edges.max()) <= 31


def test_colours_convert_as_in_the_standard_library():
    colours = [
        (0, 0, 0),
        (1, 1, 1),
        (1, 0, 0),
        (0.2, 0.9, 0.4),
        (0.1, 0.3, 0.8),
        (0.7, 0.1, 0.6),
        (0.5, 0.5, 0.2),
    ]
    pixels = torch.tensor(colours, dtype=torch.float32).T.reshape(1, 1, 3, 1, len(colours))
    hsv = rgb_to_hsv(pixels)
    expected = [colorsys.rgb_to_hsv(*colour) for colour in colours]
    np.testing.assert_allclose(hsv[0, 0, :, 0].T, expected, atol=1e-6)
    torch.testing.assert_close(hsv_to_rgb(hsv), pixels)


def test_colours_of_a_stack_change_together():
    torch.manual_seed(0)
    pixels = torch.rand(5, 1, 3, 4, 4).expand(5, 3, 3, 4, 4)
    changed = color_jitter(pixels, generator())
    assert torch.equal(changed[:, 0], changed[:, 2])
    assert float((changed - pixels).abs().amax((1, 2, 3, 4)).min()) > 0.05
    assert float(changed.min()) >= 0
    assert float(changed.max()) <= 1


def test_every_augmentation_repeats_itself():
    frames = coordinates(4, 3, 40, 40)
    asked = config("crop", "grayscale", "cutout", "color_jitter")
    first, again, other = (random_view(frames, asked, generator(seed))[0] for seed in (1, 1, 2))
    assert first.shape == (4, 3, 3, 36, 36)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
