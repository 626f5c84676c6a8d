"""The loss against a plain loop over pixels; what counts and what does not."""

import math
from dataclasses import replace

import pytest
import torch

from pretrain.losses import mae_loss, masked_mean, symlog
from pretrain.mae import MAEOutput


@pytest.fixture
def batch(mae_config, make_batch):
    batch = make_batch(mae_config, batch_size=3)
    depth = batch.depth.clone()
    depth[:, :5] = 0
    return replace(batch, depth=depth)


@pytest.fixture
def output(batch):
    generator = torch.Generator().manual_seed(1)
    return MAEOutput(
        image=torch.rand(batch.depth.shape, generator=generator)[:, None],
        reward=torch.randn(3, generator=generator),
    )


@pytest.mark.parametrize("reward_loss", ["symlog", "mse"])
def test_loss_agrees_with_a_plain_loop(mae_config, batch, output, reward_loss):
    config = replace(mae_config, reward_loss=reward_loss)
    loss, metrics = mae_loss(output, batch, config)
    errors, hidden = [], []
    for predicted, true, is_hidden in zip(
        output.depth.flatten().tolist(),
        batch.depth.flatten().tolist(),
        batch.is_hidden.flatten().tolist(),
        strict=True,
    ):
        if true > 0:
            errors.append((predicted - min(true, 10) / 10) ** 2)
            hidden += [errors[-1]] if is_hidden else []
    rewards = []
    for predicted, true, has in zip(
        output.reward.tolist(), batch.reward.tolist(), batch.has_reward.tolist(), strict=True
    ):
        target = math.copysign(math.log1p(abs(true)), true) if reward_loss == "symlog" else true
        rewards += [(predicted - target) ** 2] if has else []
    depth_loss, reward_loss = sum(errors) / len(errors), sum(rewards) / len(rewards)
    assert metrics["mae/depth_loss"].item() == pytest.approx(depth_loss, rel=1e-5)
    assert metrics["mae/reward_loss"].item() == pytest.approx(reward_loss, rel=1e-5)
    assert metrics["mae/hidden_depth_loss"].item() == pytest.approx(sum(hidden) / len(hidden), rel=1e-5)
    assert loss.item() == pytest.approx(depth_loss + reward_loss, rel=1e-5)


def test_invalid_pixels_and_missing_rewards_have_no_gradient(mae_config, batch, output):
    image, reward = output.image.requires_grad_(), output.reward.requires_grad_()
    mae_loss(output, batch, mae_config)[0].backward()
    assert not image.grad[:, 0][batch.depth == 0].any()
    assert image.grad[:, 0][batch.depth > 0].all()
    assert (reward.grad != 0).tolist() == batch.has_reward.tolist()


def test_a_batch_without_valid_depth_or_reward_has_loss_zero(mae_config, batch, output):
    empty = replace(batch, depth=torch.zeros_like(batch.depth), has_reward=torch.zeros(3, dtype=torch.bool))
    assert mae_loss(output, empty, mae_config)[0] == 0


def test_fractions_are_reported(mae_config, batch, output):
    _, metrics = mae_loss(output, replace(batch, is_truncated=torch.tensor([True, False, False])), mae_config)
    assert metrics["mae/truncation_rate"] == pytest.approx(1 / 3)
    assert metrics["mae/mask_fraction"] == pytest.approx(12 * 20 / (32 * 48))


def test_symlog_is_odd_and_grows_like_a_logarithm():
    x = torch.tensor([-100.0, -1.0, 0.0, 1e-4, 10.0])
    expected = torch.tensor([-math.log(101), -math.log(2), 0.0, 1e-4, math.log(11)])
    torch.testing.assert_close(symlog(x), expected, rtol=1e-4, atol=1e-7)


def test_masked_mean_of_nothing_is_zero():
    assert masked_mean(torch.ones(3), torch.zeros(3, dtype=torch.bool)) == 0
