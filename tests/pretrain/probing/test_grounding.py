"""Right, empty and contradicting captions on the same pixels and masks: errors are what they should be."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from langwm_data.config_io import ConfigError
from langwm_data.labels.captions import format_distance
from pretrain.config import ObjectMaskConfig
from pretrain.probing.claims import CAPTIONS, CATEGORY, DIRECTION, DISTANCE, EMPTY, OTHER, RIGHT
from pretrain.probing.compare import heed_distance
from pretrain.probing.grounding import (
    BOX,
    ELSEWHERE,
    MARGIN,
    MEAN,
    OBJECT,
    PIXEL_MEAN,
    REGIONS,
    measure_grounding,
    predict_with_captions,
)
from pretrain.probing.scene import DepthPrior, make_probe_scene

UNTOLD_M = 8.0


def said_m(text):
    whole = [m for m in range(1, 20) if f" {format_distance(m, 'integer')}" in text]
    return whole[0] if whole else 0.5


@pytest.fixture
def prior(train_frames):
    return DepthPrior.of(train_frames, 10.0)


@pytest.fixture
def believed(believer, saying_text, planted, prior):
    return measure_grounding(believer, saying_text, planted, prior, seed=0)


def test_one_object_is_hidden_and_truly_described(scene):
    assert len(scene) == len(scene.batch) == 6
    for i, shown in enumerate(scene.objects):
        x1, y1, x2, y2 = map(int, shown.bbox_xyxy)
        assert scene.batch.is_hidden[i, y1:y2, x1:x2].all()
        assert shown.category in scene.batch.captions[i]
        rows, columns = torch.nonzero(scene.is_object[i], as_tuple=True)
        assert (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1) == (x1, x2, y1, y2)


def test_every_model_is_asked_the_same(scene, held_out, text):
    config = replace(_objects(), max_objects=1, captions="none", hides=False)
    again = make_probe_scene(held_out, text, config, num_frames=6, seed=0)
    assert again.claims == scene.claims
    assert torch.equal(again.batch.is_hidden, scene.batch.is_hidden)


def _objects():
    from pretrain.config import ObjectMaskConfig

    return ObjectMaskConfig(max_objects=3, caption_dropout=0.5, box_dropout=0.5)


def test_a_model_that_believes_is_right_when_told_the_truth(believed):
    assert believed.errors[RIGHT][OBJECT] == pytest.approx(np.zeros(8), abs=1e-5)
    assert believed.errors[CATEGORY][OBJECT] == pytest.approx(np.zeros(8), abs=1e-5)
    direction = believed.errors[DIRECTION][OBJECT]
    assert direction[np.isfinite(direction)] == pytest.approx(0, abs=1e-5)


def test_a_model_that_believes_is_wrong_by_what_it_is_told(believed):
    for name in (DISTANCE, OTHER):
        for i, told in enumerate(believed.scene.claims):
            expected = abs(said_m(told[name].text) - said_m(told[RIGHT].text))
            assert believed.errors[name][OBJECT][i] == pytest.approx(expected, abs=1e-5)
    truth = [said_m(told[RIGHT].text) for told in believed.scene.claims]
    assert believed.errors[EMPTY][OBJECT] == pytest.approx(np.abs(UNTOLD_M - np.array(truth)), abs=1e-5)
    assert all(
        np.allclose(believed.errors[name][ELSEWHERE], 0, atol=1e-5) for name in (RIGHT, EMPTY, DISTANCE)
    )


def test_margin_is_the_box_without_the_object(believed):
    batch = believed.scene.batch
    for i, told in enumerate(believed.scene.claims):
        where = (batch.is_hidden[i] & ~believed.scene.is_object[i]).numpy()
        expected = np.abs(said_m(told[RIGHT].text) - batch.depth[i].numpy())[where].mean()
        assert believed.errors[RIGHT][MARGIN][i] == pytest.approx(expected, rel=1e-4)


def test_contradicted_distance_is_followed_by_as_much_as_is_said(believed):
    found = heed_distance(believed.scene.claims, believed.depths, np.random.default_rng(0))
    assert found.mean == pytest.approx(1, abs=0.1)


def test_errors_are_mean_absolute_metres_in_the_box(scene, model, text, prior):
    result = measure_grounding(model, text, scene, prior, seed=3)
    depth = predict_with_captions(model, text, scene, 3, rows=slice(0, 64))
    for i, told in enumerate(scene.claims):
        where = (scene.batch.is_hidden[i] & (scene.batch.depth[i] > 0)).numpy()
        true = scene.batch.depth[i].numpy()[where]
        for name in CAPTIONS:
            expected = np.abs(depth[name][i].numpy()[where] - true).mean() if name in told else np.nan
            assert result.errors[name][BOX][i] == pytest.approx(expected, rel=1e-4, nan_ok=True)
        assert result.errors[MEAN][BOX][i] == pytest.approx(np.abs(prior.mean_m - true).mean(), rel=1e-4)
        per_pixel = np.abs(prior.pixel_mean_m[where] - true).mean()
        assert result.errors[PIXEL_MEAN][BOX][i] == pytest.approx(per_pixel, rel=1e-4)


def test_captions_are_all_that_differs(scene, model, text):
    same = tuple({**told, OTHER: told[RIGHT]} for told in scene.claims)
    depth = predict_with_captions(model, text, replace(scene, claims=same), 0)
    assert torch.equal(depth[RIGHT], depth[OTHER])
    assert not torch.equal(depth[RIGHT], depth[EMPTY])


def test_frames_in_parts_have_the_same_truth(believed, believer, saying_text, planted, prior, monkeypatch):
    monkeypatch.setattr("pretrain.probing.grounding._CHUNK", 3)
    seen = []
    again = measure_grounding(
        believer, saying_text, planted, prior, seed=0, progress=lambda *n: seen.append(n)
    )
    for name, by_region in believed.errors.items():
        for region in REGIONS:
            np.testing.assert_allclose(again.errors[name][region], by_region[region], atol=1e-5)
    assert seen == [(3, 8), (6, 8), (8, 8)]


def test_objects_without_valid_depth_are_refused_whatever_else_their_boxes_hide(scene, model, text, prior):
    depth = torch.where(scene.is_object, 0.0, scene.batch.depth)
    none = replace(scene, batch=replace(scene.batch, depth=depth))
    with pytest.raises(ConfigError, match="none of the 6 hidden objects has a pixel with valid depth"):
        measure_grounding(model, text, none, prior, seed=0)


def test_prior_is_the_mean_over_valid_pixels(held_out):
    frames = held_out.batch(range(len(held_out)))
    prior = DepthPrior.of(held_out, 4.0)
    clipped = np.minimum(frames.depth, 4.0)
    assert prior.mean_m == pytest.approx(clipped[frames.depth > 0].mean(), rel=1e-5)
    np.testing.assert_allclose(prior.pixel_mean_m, clipped.mean(axis=0), rtol=1e-5)


def test_rows_can_be_written_as_parquet(believed, tmp_path):
    pq.write_table(believed.to_table(split="test"), tmp_path / "probe.parquet")
    rows = pq.read_table(tmp_path / "probe.parquet").to_pylist()
    right = [row for row in rows if row["caption"] == RIGHT]
    assert [row["key"] for row in right] == list(believed.scene.keys)
    assert [row["error_object_m"] for row in right] == pytest.approx(list(believed.errors[RIGHT][OBJECT]))
    told = sum(len(claims) for claims in believed.scene.claims)
    assert len(rows) == told + 2 * len(believed.scene)
    assert {row["split"] for row in rows} == {"test"}
    assert all(row["told_distance_m"] is None for row in rows if row["caption"] in (EMPTY, MEAN))


def test_frames_without_objects_are_refused(held_out, text):
    held_out.objects = [[] for _ in held_out.objects]
    with pytest.raises(ConfigError, match="show no object that could be hidden"):
        make_probe_scene(held_out, text, _objects(), num_frames=6, seed=0)


def test_lies_are_drawn_from_a_part_of_many_objects(held_out, text, monkeypatch):
    monkeypatch.setattr("pretrain.probing.scene.MAX_DONORS", 1)
    scene = make_probe_scene(held_out, text, ObjectMaskConfig(), num_frames=8, seed=0)
    told = [claims[CATEGORY].text for claims in scene.claims if CATEGORY in claims]
    nouns = {noun for noun in ("chair", "sofa", "bed") if any(noun in text for text in told)}
    assert told
    assert len(nouns) == 1
