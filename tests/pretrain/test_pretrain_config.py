"""Presets and limits: the paper's table row by row, and what is refused."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.config_io import ConfigError, build_config, config_to_dict, load_config, preset_names
from pretrain.config import MAEConfig, PretrainConfig


def load(*presets, **values):
    return load_config(PretrainConfig, "pretrain", presets=presets, overrides=values)


def test_preset_paper_is_table_2_row_by_row():
    config = load("paper")
    augment, objects, mae = config.augment, config.objects, config.mae
    assert augment.padding_px == 10
    assert (augment.hue, augment.brightness, augment.contrast, augment.saturation) == (0.1, 0.4, 0.4, 0.2)
    assert augment.blur_sigma_px == (0.1, 2.0)
    assert (mae.height, mae.width) == (128, 160)
    assert config.batch_size == 16 * 50
    assert mae.conv_channels == (32, 64, 128, 256)
    assert (*mae.grid, mae.dim) == (8, 10, 256)
    assert config.text.num_tokens + 1 == 21
    assert mae.num_patches + config.text.num_tokens + 1 + 1 == 102
    assert (mae.mask_ratio, mae.num_kept) == (0.75, 20)
    assert (mae.num_heads, mae.mlp_ratio, mae.encoder_layers, mae.decoder_layers) == (4, 4, 4, 3)
    assert (mae.layer_norm_eps, mae.dropout) == (1e-6, 0.1)
    assert (config.optimizer.learning_rate, config.optimizer.epsilon) == (1e-4, 1e-5)
    assert config.optimizer.max_grad_norm == 100
    assert (config.optimizer.schedule, config.optimizer.warmup_steps) == ("constant", 2500)
    assert (objects.max_objects, objects.margin_px, objects.max_area) == (3, 10, 0.75)
    assert (objects.caption_dropout, objects.box_dropout) == (0, 0)
    assert config.text.model == "bert-base-uncased"


def test_defaults_are_the_paper_but_for_the_rewards_loss():
    literal = load("paper")
    assert (load().mae.reward_loss, literal.mae.reward_loss) == ("symlog", "mse")
    assert load(mae={"reward_loss": "mse"}) == literal


@given(ratio=st.integers(0, 99), grid=st.sampled_from([(64, 64), (128, 160), (160, 192)]))
@settings(deadline=None)
def test_tokens_kept_are_those_of_exact_arithmetic(ratio, grid):
    num_patches = grid[0] * grid[1] // 256
    expected = int(num_patches * (1 - Fraction(ratio, 100)))
    if expected:
        config = MAEConfig(height=grid[0], width=grid[1], mask_ratio=ratio / 100)
        assert config.num_kept == expected


@pytest.mark.parametrize("name", preset_names("pretrain"))
def test_presets_are_valid_and_round_trip(name):
    config = load(name)
    assert build_config(PretrainConfig, config_to_dict(config)) == config


def test_tiny_keeps_the_layout_of_the_paper():
    tiny, paper = load("tiny").mae, load("paper").mae
    assert (tiny.height, tiny.width, tiny.grid) == (paper.height, paper.width, paper.grid)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mae": {"height": 100}}, "^mae.height 100 must be a multiple of 16: 4 convolutions each halve"),
        ({"mae": {"width": 100}}, "mae.width 100 must be a multiple of 16"),
        ({"mae": {"dim": 130}}, "mae.dim 130 must be a multiple of 4 and of num_heads 4"),
        ({"mae": {"mask_ratio": 1.0}}, "field 'mae.mask_ratio': value 1.0 is not allowed"),
        ({"mae": {"mask_ratio": 0.999}}, "mae.mask_ratio 0.999 leaves none of the 80 visual tokens"),
        ({"augment": {"blur_sigma_px": [2.0, 0.1]}}, "augment.blur_sigma_px 2.0 to 0.1 is not a range"),
        ({"text": {"num_tokens": 1}}, "field 'text.num_tokens': value 1 is not allowed"),
        ({"objects": {"max_object": 1}}, r"'objects.max_object' is unknown \(did you mean 'max_objects'\?\)"),
        ({"optimizer": {"schedule": "linear"}}, "field 'optimizer.schedule': value 'linear' is not allowed"),
        ({"optimizer": {"precision": "fp16"}}, "field 'optimizer.precision': value 'fp16' is not allowed"),
    ],
)
def test_wrong_values_are_refused_in_a_sentence(values, message):
    with pytest.raises(ConfigError, match=message):
        load(**values)


def test_any_number_of_convolutions_that_divides_the_image():
    assert MAEConfig(conv_channels=(8, 8)).grid == (32, 40)
    assert MAEConfig(conv_channels=(8,) * 5).grid == (4, 5)
