"""The optimizer step: warm-up, clipping, and what happens when training diverges."""

import pytest
import torch
from torch import nn

from pretrain.config import OptimConfig
from pretrain.optim import make_optimizer, optimizer_step


def test_agrees_with_adam_written_out():
    torch.manual_seed(0)
    layer, config = nn.Linear(3, 1), OptimConfig(learning_rate=0.01, epsilon=1e-5, warmup_steps=4)
    optimizer, x = make_optimizer(layer, config), torch.randn(5, 3)
    weight = layer.weight.detach().clone().double()
    m, v = torch.zeros_like(weight), torch.zeros_like(weight)
    for step in range(6):
        loss = layer(x).square().mean()
        metrics = optimizer_step(loss, optimizer, config, step)
        gradient = layer.weight.grad.double()
        m, v = 0.9 * m + 0.1 * gradient, 0.999 * v + 0.001 * gradient**2
        rate = 0.01 * min(1, (step + 1) / 4)
        unbiased = m / (1 - 0.9 ** (step + 1)), v / (1 - 0.999 ** (step + 1))
        weight = weight - rate * unbiased[0] / (unbiased[1].sqrt() + 1e-5)
        torch.testing.assert_close(layer.weight.double(), weight, rtol=1e-4, atol=1e-6)
        assert metrics["learning_rate"] == pytest.approx(rate)


def test_gradient_is_clipped_to_its_norm():
    layer, config = nn.Linear(2, 1, bias=False), OptimConfig(max_grad_norm=0.5, warmup_steps=0)
    optimizer = make_optimizer(layer, config)
    metrics = optimizer_step((layer.weight * torch.tensor([3.0, 4.0])).sum(), optimizer, config, 0)
    assert metrics["grad_norm"] == pytest.approx(5)
    torch.testing.assert_close(layer.weight.grad.norm(), torch.tensor(0.5), rtol=1e-4, atol=1e-5)


def test_divergence_is_reported_and_leaves_the_weights():
    layer, config = nn.Linear(2, 1), OptimConfig()
    optimizer, before = make_optimizer(layer, config), layer.weight.detach().clone()
    with pytest.raises(FloatingPointError, match="the loss is nan at step 12; try a lower learning rate"):
        optimizer_step(layer(torch.full((1, 2), float("nan"))).sum(), optimizer, config, 12)
    assert torch.equal(layer.weight, before)


def test_frozen_weights_are_left_out():
    layer = nn.Linear(2, 2)
    layer.bias.requires_grad_(False)
    assert len(make_optimizer(layer, OptimConfig()).param_groups[0]["params"]) == 1
