"""Pictures show what they say: colours against matplotlib's, every image at its place."""

import matplotlib
import numpy as np
import torch

from pretrain.mae import IMAGENET_MEAN
from pretrain.pictures import depth_to_rgb, hide_pixels, mae_panel, make_panel


def test_near_is_warm_and_far_is_cool_as_in_matplotlibs_turbo():
    depth = np.array([[0.01, 2.5, 5.0, 10.0, 30.0]], np.float32)
    expected = matplotlib.colormaps["turbo"](1 - np.minimum(depth, 10) / 10)[..., :3] * 255
    assert np.abs(depth_to_rgb(depth, 10.0) - expected).max() <= 4


def test_invalid_depth_is_black():
    assert depth_to_rgb(np.array([[0.0, 1.0]], np.float32), 10.0)[0].any(axis=1).tolist() == [False, True]


def test_hidden_pixels_are_shown_in_the_colour_that_the_network_gets():
    rgb = np.full((2, 2, 3), 7, np.uint8)
    shown = hide_pixels(rgb, np.array([[True, False], [False, False]]))
    assert np.abs(shown[0, 0] / 255 - IMAGENET_MEAN).max() < 1 / 255
    assert (shown.reshape(-1, 3)[1:] == 7).all()
    assert (rgb == 7).all()


def test_panel_has_every_image_at_its_place():
    rows = [[np.full((6, 40, 3), 10 * r + c, np.uint8) for c in range(3)] for r in range(2)]
    panel = make_panel(("a", "b", "c"), rows, ("first", ""))
    assert panel.shape == (18 + 2 * (6 + 18), 3 * (40 + 4), 3)
    for r in range(2):
        for c in range(3):
            top, left = 18 + r * 24, c * 44
            assert (panel[top : top + 6, left : left + 40] == 10 * r + c).all()
            assert (panel[top : top + 6, left + 40 : left + 44] == 255).all()


def test_panel_of_a_batch_shows_input_mask_prediction_and_truth(mae_config, make_batch):
    batch = make_batch(mae_config, batch_size=3)
    predicted = torch.rand_like(batch.depth).numpy() * 10
    panel = mae_panel(batch, predicted[:, None], 10.0, count=2)
    assert len(panel) == 18 + 2 * (32 + 18)
    second = panel[18 + 50 : 18 + 50 + 32]
    assert np.array_equal(second[:, :48], batch.rgb[1])
    assert np.array_equal(second[:, 52:100], hide_pixels(batch.rgb[1].numpy(), batch.is_hidden[1].numpy()))
    assert np.array_equal(second[:, 104:152], depth_to_rgb(predicted[1], 10.0))
    assert np.array_equal(second[:, 156:204], depth_to_rgb(batch.depth[1].numpy(), 10.0))
