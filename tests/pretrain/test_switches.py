"""Each switch does what it says: sentences apart, objects unhidden, scenes described, colours filled in."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from pretrain import LanguageGroundedMAE, pretrain_mae
from pretrain.config import ObjectMaskConfig, TextConfig
from pretrain.frames import FrameObject
from pretrain.language import FrozenText, split_sentences
from pretrain.losses import mae_loss
from pretrain.mae import IMAGENET_MEAN, IMAGENET_STD
from pretrain.metrics import read_metrics
from pretrain.object_masking import hide_objects
from pretrain.pictures import colors_to_rgb

CHAIR, SOFA = "There is chair in the left 3 meters.", "The sofa is approximately 1.5 meters, front from here."
SIZE = (32, 48)


@pytest.fixture(scope="module")
def apart(bert_folder):
    """Three sentences, each with tokens of its own."""
    return FrozenText(TextConfig(model=str(bert_folder), num_sentences=3))


def test_sentences_end_at_stops_and_not_inside_numbers():
    assert split_sentences(f"{CHAIR} {SOFA}") == (CHAIR, SOFA)
    assert split_sentences("") == ("",)


def test_each_sentence_has_the_tokens_that_it_has_alone(apart, text):
    tokens, is_cut = apart.embed([f"{CHAIR} {SOFA}", ""])
    assert tokens.embed.shape[1] == 3 * 21
    for place, sentence in enumerate((CHAIR, SOFA)):
        alone, _ = text.embed([sentence])
        rows = slice(21 * place, 21 * (place + 1))
        assert torch.equal(tokens.embed[0, rows], alone.embed[0])
        assert torch.equal(tokens.attend[0, rows], alone.attend[0])
    assert not tokens.attend[0, 42:].any()
    assert torch.equal(tokens.attend[1], apart.null_text.attend[0])
    assert tokens.attend[1].sum() == text.null_text.attend.sum()
    assert not is_cut.any()


def test_sentences_past_the_last_place_are_left_out_and_told(apart):
    tokens, is_cut = apart.embed([" ".join([CHAIR] * 3), " ".join([CHAIR] * 4)])
    assert is_cut.tolist() == [False, True]
    assert torch.equal(tokens.embed[0], tokens.embed[1])


def test_joined_sentences_are_cut_where_sentences_apart_are_not(apart, text):
    caption = f"{CHAIR} {SOFA}"
    assert text.embed([caption])[1].item()
    assert not apart.embed([caption])[1].item()


def test_a_set_of_sentences_has_no_order(apart, mae_config, make_batch):
    torch.manual_seed(0)
    mae = LanguageGroundedMAE(mae_config, apart.config, apart.null_text).eval()
    rgb = make_batch(mae_config).rgb
    with torch.no_grad():
        visual = mae.patchify(rgb)
        first, second = (
            mae.encode_tokens(visual, apart.embed([caption] * len(rgb))[0])
            for caption in (f"{CHAIR} {SOFA}", f"{SOFA} {CHAIR}")
        )
        other = mae.encode_tokens(visual, apart.embed([CHAIR] * len(rgb))[0])
    torch.testing.assert_close(first, second)
    assert (first - other).abs().max() > 1e-4


def test_144_tokens_with_three_sentences_apart(make_text):
    config = TextConfig(model="x", num_sentences=3)
    assert 1 + 80 + config.num_language_tokens == 144


def test_places_that_nobody_looks_at_are_left_out_of_the_empty_caption(apart, mae_config, make_batch):
    torch.manual_seed(0)
    mae = LanguageGroundedMAE(mae_config, apart.config, apart.null_text).eval()
    rgb = make_batch(mae_config).rgb
    seen = []
    mae.encoder.register_forward_pre_hook(lambda _, arguments: seen.append(arguments[0].shape[1]))
    whole, _ = apart.embed([""] * len(rgb))
    with torch.no_grad():
        expected = mae.encode_tokens(mae.patchify(rgb), whole)
    torch.testing.assert_close(mae.encode(rgb), expected)
    assert seen == [1 + mae_config.num_patches + 3 * 21, 1 + mae_config.num_patches + 21]


def test_a_model_of_sentences_apart_is_read_back(apart, mae_config, make_batch, tmp_path):
    mae = LanguageGroundedMAE(mae_config, apart.config, apart.null_text).eval()
    mae.save_pretrained(tmp_path)
    rgb = make_batch(mae_config).rgb
    assert torch.equal(LanguageGroundedMAE.from_pretrained(tmp_path).encode(rgb), mae.encode(rgb))


def objects():
    return [
        FrameObject(category="chair", bbox_xyxy=(2.0, 2.0, 8.0, 8.0), center_x=5.0, distance_m=2.0),
        FrameObject(category="sofa", bbox_xyxy=(20.0, 8.0, 44.0, 30.0), center_x=32.0, distance_m=1.0),
        FrameObject(category="bed", bbox_xyxy=(1.0, 12.0, 17.0, 28.0), center_x=9.0, distance_m=3.0),
    ]


def hidden(**changes):
    rng = np.random.default_rng(0)
    return hide_objects(
        rng, objects(), SIZE, ObjectMaskConfig(**{"max_objects": 2, "max_area": 1.0} | changes)
    )


def test_objects_can_be_told_of_without_being_hidden():
    shown, boxed = hidden(hides=False), hidden()
    assert not shown.is_hidden.any()
    assert shown.objects == ()
    assert boxed.is_hidden.any()
    assert shown.caption == boxed.caption != ""


def test_captions_of_the_scene_are_about_its_largest_objects():
    told = hidden(captions="scene", hides=False)
    assert sorted(word for word in ("chair", "sofa", "bed") if word in told.caption) == ["bed", "sofa"]
    assert hidden(captions="scene", box_dropout=1.0).caption != ""


def test_nothing_is_said_where_language_is_off():
    silent = hidden(captions="none")
    assert silent.caption == ""
    assert np.array_equal(silent.is_hidden, hidden().is_hidden)
    assert len(silent.objects) == 2


def test_colours_as_the_target(mae_config, text, make_batch):
    config = replace(mae_config, target="rgb")
    mae = LanguageGroundedMAE(config, text.config, text.null_text)
    batch = make_batch(config)
    output = mae(batch, mae.token_noise(2, torch.Generator().manual_seed(0)))
    assert output.image.shape == (2, 3, 32, 48)
    loss, metrics = mae_loss(output, batch, config)
    plain = (batch.rgb.double() / 255 - torch.tensor(IMAGENET_MEAN)) / torch.tensor(IMAGENET_STD)
    error = (output.image.detach().permute(0, 2, 3, 1) - plain).square().mean()
    assert metrics["mae/rgb_loss"].item() == pytest.approx(error.item(), rel=1e-5)
    assert loss.isfinite()
    with pytest.raises(AssertionError, match="this model fills in colours"):
        _ = output.depth


def test_every_output_pixel_is_its_own(mae_config, text, make_batch):
    """One weight of the head moves one colour of one place in every patch, row by row."""
    config = replace(mae_config, target="rgb")
    mae = LanguageGroundedMAE(config, text.config, text.null_text).eval()
    ids = torch.arange(config.num_patches)[None]
    tokens = torch.zeros(1, 1 + config.num_patches, config.dim)
    with torch.no_grad():
        mae.image_head.weight.zero_()
        mae.image_head.bias.copy_(torch.arange(3 * 64.0))
        image, _ = mae.decode_tokens(tokens, ids)
    assert image[0, :, 8:16, 16:24].flatten().tolist() == list(range(3 * 64))


def test_colours_go_there_and_back(make_batch, mae_config):
    rgb = make_batch(mae_config).rgb[0].numpy()
    units = ((rgb / 255 - IMAGENET_MEAN) / IMAGENET_STD).transpose(2, 0, 1).astype(np.float32)
    assert np.array_equal(colors_to_rgb(units), rgb)


def test_a_run_with_colours_is_watched_by_colours(pretrain_config, data_folder, tmp_path):
    config = replace(pretrain_config, mae=replace(pretrain_config.mae, target="rgb"))
    run = pretrain_mae(config, data_folder, tmp_path / "run")
    rows = read_metrics(run)
    assert all(np.isfinite(row["mae/rgb_loss"]) for row in rows)
    assert np.isfinite(rows[-1]["valid/rgb_loss"])
    assert "valid/depth_error_m" not in rows[-1]
    assert cv2.imread(str(run / "pictures" / "step-000000004.png")) is not None
