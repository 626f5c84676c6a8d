"""The optimizer step: warm-up, schedule, clipping, and what happens when training diverges."""

from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn
from torch.optim import lr_scheduler

from pretrain.config import OptimConfig
from pretrain.optim import Optimizer, learning_rate_at


def test_agrees_with_adam_written_out():
    torch.manual_seed(0)
    layer, config = nn.Linear(3, 1), OptimConfig(learning_rate=0.01, epsilon=1e-5, warmup_steps=4)
    optimizer, x = Optimizer(layer, config), torch.randn(5, 3)
    weight = layer.weight.detach().clone().double()
    m, v = torch.zeros_like(weight), torch.zeros_like(weight)
    for step in range(6):
        loss = layer(x).square().mean()
        metrics = optimizer.step(loss, step)
        gradient = layer.weight.grad.double()
        m, v = 0.9 * m + 0.1 * gradient, 0.999 * v + 0.001 * gradient**2
        rate = 0.01 * min(1, (step + 1) / 4)
        unbiased = m / (1 - 0.9 ** (step + 1)), v / (1 - 0.999 ** (step + 1))
        weight = weight - rate * unbiased[0] / (unbiased[1].sqrt() + 1e-5)
        torch.testing.assert_close(layer.weight.double(), weight, rtol=1e-4, atol=1e-6)
        assert metrics["learning_rate"] == pytest.approx(rate)


@given(warmup=st.integers(1, 8), after=st.integers(1, 12))
@settings(max_examples=30, deadline=None)
def test_cosine_agrees_with_torchs_schedulers(warmup, after):
    config = OptimConfig(learning_rate=0.5, warmup_steps=warmup, schedule="cosine")
    theirs = torch.optim.SGD([nn.Parameter(torch.zeros(1))], lr=0.5)
    rise = lr_scheduler.LinearLR(theirs, start_factor=1 / warmup, total_iters=max(warmup - 1, 1))
    fall = lr_scheduler.CosineAnnealingLR(theirs, T_max=after)
    both = lr_scheduler.SequentialLR(theirs, [rise, fall], milestones=[warmup])
    for step in range(warmup + after):
        expected = theirs.param_groups[0]["lr"]
        assert learning_rate_at(config, step, warmup + after) == pytest.approx(expected, abs=1e-9)
        theirs.step()
        both.step()


def test_cosine_falls_from_the_full_rate_to_nearly_zero_and_no_further():
    config = OptimConfig(learning_rate=1.0, warmup_steps=10, schedule="cosine")
    rates = [learning_rate_at(config, step, 110) for step in range(110)]
    assert rates[9] == rates[10] == 1
    assert rates[60] == pytest.approx(0.5)
    assert 0 < rates[-1] < 1e-3
    assert all(a > b for a, b in pairwise(rates[10:]))
    assert learning_rate_at(config, 500, 110) == pytest.approx(0, abs=1e-9)


def test_warm_up_longer_than_the_run_only_rises():
    config = OptimConfig(learning_rate=1.0, warmup_steps=10, schedule="cosine")
    assert [learning_rate_at(config, step, 4) for step in range(4)] == [0.1, 0.2, 0.3, 0.4]


def test_constant_rate_needs_no_length():
    config = OptimConfig(learning_rate=1.0, warmup_steps=0)
    assert [learning_rate_at(config, step) for step in (0, 10**6)] == [1, 1]


def test_schedule_reaches_the_weights():
    layer = nn.Linear(2, 1, bias=False)
    config = OptimConfig(learning_rate=0.1, epsilon=1e-12, warmup_steps=0, schedule="cosine")
    optimizer = Optimizer(layer, config, total_steps=4)
    for step in range(4):
        before = layer.weight.detach().clone()
        optimizer.step(layer.weight.sum(), step)  # a constant gradient moves Adam by the rate itself
        moved = before - layer.weight
        assert moved.flatten().tolist() == pytest.approx([learning_rate_at(config, step, 4)] * 2, rel=1e-3)


def test_gradient_is_clipped_to_its_norm():
    layer, config = nn.Linear(2, 1, bias=False), OptimConfig(max_grad_norm=0.5, warmup_steps=0)
    optimizer = Optimizer(layer, config)
    metrics = optimizer.step((layer.weight * torch.tensor([3.0, 4.0])).sum(), 0)
    assert metrics["grad_norm"] == pytest.approx(5)
    torch.testing.assert_close(layer.weight.grad.norm(), torch.tensor(0.5), rtol=1e-4, atol=1e-5)


def test_divergence_is_reported_and_leaves_the_weights():
    layer = nn.Linear(2, 1)
    optimizer, before = Optimizer(layer, OptimConfig()), layer.weight.detach().clone()
    message = "the loss is nan at step 12 and its gradient's norm nan; try a learning rate below 0.0001"
    with pytest.raises(FloatingPointError, match=message):
        optimizer.step(layer(torch.full((1, 2), float("nan"))).sum(), 12)
    assert torch.equal(layer.weight, before)


def test_infinite_gradient_of_a_finite_loss_is_reported():
    layer = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(layer.weight)
    with pytest.raises(FloatingPointError, match=r"the loss is 0.0 at step 3 and its gradient's norm inf"):
        Optimizer(layer, OptimConfig()).step(layer.weight.sqrt().sum(), 3)


def test_frozen_weights_are_left_out():
    layer = nn.Linear(2, 2)
    layer.bias.requires_grad_(False)
    before = layer.bias.detach().clone()
    optimizer = Optimizer(layer, OptimConfig(warmup_steps=0))
    optimizer.step(layer(torch.ones(1, 2)).sum(), 0)
    assert torch.equal(layer.bias, before)
    assert len(optimizer.state_dict()["state"]) == 1
