import numpy as np
import pytest
import torch
from torch.distributions import Categorical

from agent.config import MLPConfig
from agent.models.readout import PointReadout, TwoHotReadout, make_head, make_readout

TARGETS = torch.tensor([0.0, 0.3, -0.3, 1.0, -7.5, 10.0, 123.4, -1e5, 4.8e8, -9e9])


@pytest.fixture
def twohot():
    return TwoHotReadout()


def random_logits(*shape):
    return 3 * torch.randn(*shape, 255, generator=torch.Generator().manual_seed(0))


def test_bins_are_the_symexp_of_evenly_spaced_numbers(twohot):
    even = np.linspace(-20, 20, 255)
    np.testing.assert_allclose(twohot.bins, np.sign(even) * np.expm1(np.abs(even)), rtol=2e-6, atol=1e-7)
    assert torch.equal(twohot.bins, -twohot.bins.flip(0))


def test_the_number_is_the_mean_over_the_bins(twohot):
    logits = random_logits(7)
    expected = Categorical(logits=logits.double()).probs @ twohot.bins.double()
    torch.testing.assert_close(twohot.value(logits), expected.float(), rtol=1e-4, atol=1.0)


def test_equal_logits_give_exactly_zero(twohot):
    assert torch.equal(twohot.value(torch.full((3, 255), 1.7)), torch.zeros(3))


def hand_made_two_hot(target, bins):
    """The mass of one number on the bins beside it, by a search through all of them."""
    mass = np.zeros(len(bins))
    target = min(max(target, bins[0]), bins[-1])
    for low in range(len(bins) - 1):
        if bins[low] <= target <= bins[low + 1]:
            share = (target - bins[low]) / (bins[low + 1] - bins[low])
            mass[low], mass[low + 1] = 1 - share, share
            return mass
    raise AssertionError


def test_the_loss_is_the_cross_entropy_with_the_two_bins_around_the_target(twohot):
    logits, bins = random_logits(len(TARGETS)), twohot.bins.double().numpy()
    mass = torch.tensor(np.stack([hand_made_two_hot(t, bins) for t in TARGETS.double().tolist()]))
    expected = torch.nn.functional.cross_entropy(logits.double(), mass, reduction="none")
    torch.testing.assert_close(twohot.loss(logits, TARGETS), expected.float(), rtol=1e-4, atol=1e-4)
    assert mass.sum(1) == pytest.approx(np.ones(len(TARGETS)))


def test_the_gradient_of_the_loss_is_what_is_predicted_minus_the_target(twohot):
    logits = random_logits(len(TARGETS)).requires_grad_()
    (gradient,) = torch.autograd.grad(twohot.loss(logits, TARGETS).sum(), logits)
    bins = twohot.bins.double().numpy()
    mass = torch.tensor(np.stack([hand_made_two_hot(t, bins) for t in TARGETS.double().tolist()])).float()
    torch.testing.assert_close(gradient, logits.detach().softmax(-1) - mass, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("name", ["identity", "symlog", "twohot"])
def test_a_head_learns_numbers_of_every_size(name):
    torch.manual_seed(0)
    readout = make_readout(name)
    head = make_head(4, MLPConfig(layers=2, units=64), readout)
    feat = torch.randn(8, 4)
    target = torch.tensor([0.0, 0.1, -0.1, 1.0, -1.0, 3.0, -10.0, 10.0])
    optimizer = torch.optim.Adam(head.parameters(), lr=1e-2)
    for _ in range(400):
        loss = readout.loss(head(feat), target).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    torch.testing.assert_close(readout.value(head(feat)), target, rtol=0.05, atol=0.05)


def test_a_head_with_bins_begins_at_zero():
    head = make_head(4, MLPConfig(layers=1, units=8), TwoHotReadout())
    assert torch.equal(TwoHotReadout().value(head(torch.randn(5, 4))), torch.zeros(5))
    point = make_head(4, MLPConfig(layers=1, units=8), PointReadout())
    assert PointReadout().value(point(torch.randn(5, 4))).abs().sum() > 0


def test_a_point_is_taught_by_half_the_squared_error():
    raw, target = torch.randn(6, 1), torch.randn(6)
    plain, symlog = PointReadout(), PointReadout(is_symlog=True)
    torch.testing.assert_close(plain.loss(raw, target), 0.5 * (raw[:, 0] - target) ** 2)
    squashed = target.sign() * torch.log1p(target.abs())
    torch.testing.assert_close(symlog.loss(raw, target), 0.5 * (raw[:, 0] - squashed) ** 2)
