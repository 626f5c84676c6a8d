import dataclasses

import numpy as np
import pytest
import torch

from agent.config import KeyEncoderConfig
from agent.systems import langwm
from agent.systems.agent import Agent
from agent.systems.key_encoder import second_view
from agent.train import train_agent
from langwm_data.config_io import ConfigError
from pretrain.config import AugmentConfig
from pretrain.metrics import read_metrics

MODES = ("ema_features", "infonce")


def with_key(config, mode, **changes):
    return dataclasses.replace(config, key_encoder=KeyEncoderConfig(mode=mode, **changes))


@pytest.fixture(scope="module", params=MODES)
def run(request, tiny_config, make_room, tmp_path_factory):
    config = with_key(tiny_config, request.param, momentum=0.9)
    out = tmp_path_factory.mktemp(request.param) / "run"
    return train_agent(config, out, env=make_room(max_steps=9)), config


def losses(folder):
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(folder)]


def test_a_run_that_stopped_goes_on_with_the_same_numbers(run, make_room, tmp_path):
    """Stopped twice: while the key encoder waits for pretraining, and once it follows."""
    folder, config = run
    for steps in (30, 47, 60):
        train_agent(dataclasses.replace(config, steps=steps), tmp_path, env=make_room(max_steps=9))
    assert losses(tmp_path) == losses(folder)
    ours, theirs = (Agent.from_pretrained(r).model.state_dict() for r in (tmp_path, folder))
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_the_copy_is_saved_and_is_neither_the_first_nor_the_last_mae(run, spaces):
    folder, config = run
    perception = Agent.from_pretrained(folder).model.perception
    first = langwm.create(config, spaces).perception
    learned, copy, begun = (m.cls_token for m in (perception.mae, perception.key.mae, first.mae))
    assert not torch.equal(copy, learned)
    assert not torch.equal(copy, begun)


def test_a_state_is_contrasted_only_where_asked(run):
    folder, config = run
    found = [row["wm/contrast_loss"] for row in read_metrics(folder) if "wm/contrast_loss" in row]
    assert bool(found) == (config.key_encoder.mode == "infonce")
    assert all(np.isfinite(found))


@pytest.mark.parametrize("mode", ["none", *MODES])
def test_only_ema_features_are_the_copys(mode, tiny_config, spaces):
    perception = langwm.create(with_key(tiny_config, mode), spaces).perception
    rgb = torch.randint(0, 256, (2, 16, 16, 3), dtype=torch.uint8)
    before = perception.encode({"rgb": rgb})
    with torch.no_grad():
        perception.mae.cls_token.add_(1)
    after = perception.encode({"rgb": rgb})
    assert torch.equal(before, after) == (mode == "ema_features")
    assert torch.equal(after, (perception.key if mode == "ema_features" else perception).mae.encode(rgb))


def test_the_copy_is_a_running_mean(tiny_config, spaces):
    perception = langwm.create(with_key(tiny_config, "ema_features", momentum=0.75), spaces).perception
    expected = perception.mae.cls_token.detach().clone()
    for _ in range(3):
        with torch.no_grad():
            perception.mae.cls_token.add_(torch.randn_like(expected))
        perception.key.follow(perception.mae)
        expected = 0.75 * expected + 0.25 * perception.mae.cls_token.detach()
    torch.testing.assert_close(perception.key.mae.cls_token, expected)
    assert not perception.key.mae.cls_token.requires_grad
    perception.key.catch_up(perception.mae)
    assert torch.equal(perception.key.mae.cls_token, perception.mae.cls_token)


def test_a_second_view_is_another_view_of_each_frame():
    rgb = torch.randint(0, 256, (2, 3, 16, 16, 3), dtype=torch.uint8)
    config = AugmentConfig(padding_px=2, color_probability=1.0)
    first, same, other = (second_view(np.random.default_rng(seed), rgb, config) for seed in (0, 0, 1))
    assert (first.shape, first.dtype) == (rgb.shape, torch.uint8)
    assert torch.equal(first, same)
    assert not torch.equal(first, other)
    still = AugmentConfig(
        padding_px=0, color_probability=0.0, grayscale_probability=0.0, blur_probability=0.0
    )
    assert torch.equal(second_view(np.random.default_rng(0), rgb, still), rgb)


@pytest.mark.parametrize("mode", MODES)
def test_frozen_features_have_no_running_mean(mode, frozen_config, spaces):
    with pytest.raises(ConfigError, match=f"key_encoder.mode '{mode}' needs features 'finetuned'"):
        langwm.create(with_key(frozen_config, mode), spaces)
