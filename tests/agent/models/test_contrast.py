import math

import pytest
import torch

from agent.models.contrast import TEMPERATURE, Contrast


@pytest.fixture
def contrast():
    torch.manual_seed(0)
    return Contrast(6, 4)


def test_the_loss_agrees_with_a_plain_loop(contrast):
    feat, key = torch.randn(5, 6), torch.randn(5, 4)
    total = 0.0
    for own in range(5):
        query = contrast.query(feat[own]).detach()
        cosines = [float(query @ k / query.norm() / k.norm()) / TEMPERATURE for k in key]
        total -= cosines[own] - math.log(sum(math.exp(c) for c in cosines))
    assert contrast.loss(feat, key).item() == pytest.approx(total / 5, rel=1e-5)


def test_what_cannot_be_told_apart_costs_the_logarithm_of_the_batch(contrast):
    same = torch.ones(7, 4)
    assert contrast.loss(torch.randn(7, 6), same).item() == pytest.approx(math.log(7), rel=1e-5)


def test_states_learn_to_find_their_frames_and_the_frames_learn_nothing(contrast):
    feat, key = torch.randn(8, 6, requires_grad=True), torch.randn(8, 4, requires_grad=True)
    optimizer = torch.optim.Adam([feat, *contrast.parameters()], lr=0.05)
    first = contrast.loss(feat, key).item()
    for _ in range(100):
        loss = contrast.loss(feat, key)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.2 < first
    assert key.grad is None
