"""The probe measures what it says: right, empty and wrong captions on the same pixels and masks."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from langwm_data.config_io import ConfigError
from pretrain.config import ObjectMaskConfig, TextConfig
from pretrain.dataset import open_split
from pretrain.mae import LanguageGroundedMAE
from pretrain.pictures import probe_panel
from pretrain.probe import DepthPrior, make_probe_scene, predict_with_captions, probe_grounding

SIZE = (32, 48)
OBJECTS = ObjectMaskConfig(max_objects=3, caption_dropout=0.5, box_dropout=0.5)


@pytest.fixture
def held_out(data_folder):
    return open_split(data_folder, "test", SIZE, 64)


@pytest.fixture
def scene(held_out, text):
    return make_probe_scene(held_out, text, OBJECTS, num_frames=6, seed=0)


@pytest.fixture
def model(mae_config, text):
    torch.manual_seed(0)
    return LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)


def test_one_object_is_hidden_and_truly_described(scene):
    assert len(scene.keys) == len(scene.batch) == 6
    for i, shown in enumerate(scene.objects):
        x1, y1, x2, y2 = map(int, shown.bbox_xyxy)
        assert scene.batch.is_hidden[i, y1:y2, x1:x2].all()
        assert shown.category in scene.batch.captions[i]
        assert scene.batch.captions[i].count(".") == 1


def test_wrong_captions_name_another_category_at_another_distance(scene):
    for shown, (caption, donor) in zip(scene.objects, scene.wrong, strict=True):
        assert donor.category in caption
        assert donor.category != shown.category
        assert abs(donor.distance_m - shown.distance_m) >= 1


def test_errors_are_mean_absolute_metres_in_the_box(scene, model, text, held_out):
    prior = DepthPrior.of(held_out, 10.0)
    result = probe_grounding(model, text, scene, prior, seed=3)
    depth = predict_with_captions(model, text, scene, 3)
    for i, row in enumerate(result.rows):
        where = scene.batch.is_hidden[i] & (scene.batch.depth[i] > 0)
        true = scene.batch.depth[i][where].numpy()
        for name in ("right", "empty", "wrong"):
            expected = np.abs(depth[name][i][where].numpy() - true).mean()
            assert getattr(row, f"error_{name}_m") == pytest.approx(expected, rel=1e-4)
        assert row.error_mean_m == pytest.approx(np.abs(prior.mean_m - true).mean(), rel=1e-4)
        assert row.hidden_px == int(scene.batch.is_hidden[i].sum())
    assert [d.compared for d in result.differences] == ["empty", "wrong", "mean", "pixel_mean"]
    for difference in result.differences:
        assert difference.low_m <= difference.mean_m <= difference.high_m
        expected = result.mean_error_m(difference.compared) - result.mean_error_m("right")
        assert difference.mean_m == pytest.approx(expected)


def test_captions_are_all_that_differs(scene, model, text):
    same = replace(scene, wrong=tuple(zip(scene.batch.captions, scene.objects, strict=True)))
    depth = predict_with_captions(model, text, same, 0)
    assert torch.equal(depth["right"], depth["wrong"])
    assert not torch.equal(depth["right"], depth["empty"])


def test_interval_agrees_with_the_normal_one_for_many_rows(scene, model, text, held_out):
    from pretrain.probe import _difference

    rng = np.random.default_rng(0)
    row = probe_grounding(model, text, scene, DepthPrior.of(held_out, 10.0), seed=0).rows[0]
    extra = rng.normal(0.3, 1.0, 400)
    rows = [replace(row, error_empty_m=row.error_right_m + e) for e in extra]
    found = _difference(rows, "empty", 0)
    half = 1.96 * extra.std() / 20
    assert found.low_m == pytest.approx(extra.mean() - half, abs=0.02)
    assert found.high_m == pytest.approx(extra.mean() + half, abs=0.02)


def test_boxes_without_valid_depth_are_refused(scene, model, text, held_out):
    prior = DepthPrior.of(held_out, 10.0)
    depth = scene.batch.depth.clone()
    depth[1:][scene.batch.is_hidden[1:]] = 0
    one = replace(scene, batch=replace(scene.batch, depth=depth))
    assert [row.key for row in probe_grounding(model, text, one, prior, seed=0).rows] == [scene.keys[0]]
    none = replace(scene, batch=replace(scene.batch, depth=torch.zeros_like(depth)))
    with pytest.raises(ConfigError, match="none of the 6 hidden boxes covers a pixel with valid depth"):
        probe_grounding(model, text, none, prior, seed=0)


def test_prior_is_the_mean_over_valid_pixels(held_out):
    frames = held_out.batch(range(len(held_out)))
    prior = DepthPrior.of(held_out, 4.0)
    clipped = np.minimum(frames.depth, 4.0)
    assert prior.mean_m == pytest.approx(clipped[frames.depth > 0].mean(), rel=1e-5)
    np.testing.assert_allclose(prior.pixel_mean_m, clipped.mean(axis=0), rtol=1e-5)


def test_rows_can_be_written_as_parquet(scene, model, text, held_out, tmp_path):
    result = probe_grounding(model, text, scene, DepthPrior.of(held_out, 10.0), seed=0)
    pq.write_table(result.to_table(), tmp_path / "probe.parquet")
    table = pq.read_table(tmp_path / "probe.parquet")
    assert table["key"].to_pylist() == list(scene.keys)
    assert "error_right_m" in table.column_names


def test_panel_shows_every_frame_with_its_line(scene, model, text):
    depth = predict_with_captions(model, text, scene, 0)
    panel = probe_panel(scene.batch, depth, scene.batch.captions, 10.0)
    assert panel.shape == (18 + 6 * (32 + 18), 5 * (48 + 4), 3)
    assert panel.dtype == np.uint8


def test_frames_without_objects_are_refused(held_out, text):
    held_out.objects = [[] for _ in held_out.objects]
    with pytest.raises(ConfigError, match="the held-out frames show no object that could be hidden"):
        make_probe_scene(held_out, text, OBJECTS, num_frames=6, seed=0)


def test_frames_of_one_category_are_refused(held_out, text):
    held_out.objects = [[replace(o, category="bed") for o in held] for held in held_out.objects]
    with pytest.raises(ConfigError, match="show no object that a bed could be mistaken for"):
        make_probe_scene(held_out, text, OBJECTS, num_frames=6, seed=0)
