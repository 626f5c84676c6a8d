import math

import pytest
import torch
import torch.nn.functional as F
from torch.distributions import Independent, Normal, TanhTransform, TransformedDistribution

from agent.config import SACConfig
from agent.models.sac import (
    Actor,
    Critic,
    PixelEncoder,
    TanhGaussian,
    actor_loss,
    alpha_loss,
    contrastive_loss,
    critic_loss,
    encoded_size,
    move_towards,
    target_value,
)

SMALL = SACConfig(filters=4, hidden=16, feature_dim=6)


@pytest.fixture(autouse=True)
def _seed():
    torch.manual_seed(0)


def test_the_density_of_squashed_actions_is_that_of_torch():
    mean, log_std = torch.randn(50, 3), torch.randn(50, 3).clamp(-2, 0.5)
    action, log_prob = TanhGaussian(mean, log_std).rsample(torch.Generator().manual_seed(1))
    reference = TransformedDistribution(Normal(mean, log_std.exp()), [TanhTransform(cache_size=1)])
    inner = action.abs().amax(-1) < 0.999  # beyond it, float32 cannot undo the tanh
    expected = Independent(reference, 1).log_prob(action)
    assert inner.sum() > 20
    torch.testing.assert_close(log_prob[inner], expected[inner], rtol=1e-3, atol=1e-3)


def test_densities_stay_finite_where_the_action_saturates():
    mean = torch.full((4, 1), 30.0, requires_grad=True)
    action, log_prob = TanhGaussian(mean, torch.zeros(4, 1)).rsample(torch.Generator().manual_seed(1))
    assert (action == 1).all()
    assert log_prob.isfinite().all()
    log_prob.sum().backward()
    assert mean.grad.isfinite().all()


def test_samples_have_the_mean_and_spread_of_the_policy():
    policy = TanhGaussian(torch.full((20_000, 1), 0.3), torch.full((20_000, 1), -1.0))
    raw = torch.atanh(policy.rsample(torch.Generator().manual_seed(0))[0])
    assert raw.mean().item() == pytest.approx(0.3, abs=0.01)
    assert raw.std().item() == pytest.approx(math.exp(-1), abs=0.01)
    assert torch.equal(policy.mode, policy.mean.tanh())


@pytest.mark.parametrize(
    ("size", "left"), [((128, 160), (57, 73)), ((108, 136), (47, 61)), ((28, 28), (7, 7))]
)
def test_sizes_are_computed_and_not_looked_up(size, left):
    assert encoded_size(*size) == left
    encoder = PixelEncoder(SMALL, size)
    assert encoder.convolve(torch.rand(1, 3, 3, *size)).shape == (1, 4 * left[0] * left[1])
    assert encoder(torch.rand(1, 3, 3, *size)).shape == (1, 6)


def test_targets_equal_a_loop_over_transitions():
    reward, terminal = torch.randn(7), torch.arange(7) % 3 == 0
    values, log_prob, alpha = torch.randn(7, 2), torch.randn(7), torch.tensor(0.2)
    found = target_value(reward, terminal, values, log_prob, alpha, 0.9)
    for t in range(7):
        expected = reward[t].item()
        if not terminal[t]:
            expected += 0.9 * (min(values[t].tolist()) - 0.2 * log_prob[t].item())
        assert found[t].item() == pytest.approx(expected, abs=1e-6)


def test_both_critics_are_held_to_the_same_target():
    values, target = torch.randn(5, 2), torch.randn(5)
    expected = F.mse_loss(values[:, 0], target) + F.mse_loss(values[:, 1], target)
    torch.testing.assert_close(critic_loss(values, target), expected)


def test_the_actor_trusts_the_more_doubtful_critic():
    values = torch.tensor([[1.0, 3.0], [5.0, 2.0]])
    loss = actor_loss(values, torch.tensor([0.5, -0.5]), torch.tensor(0.2))
    assert loss.item() == pytest.approx((0.1 - 1 - 0.1 - 2) / 2)


@pytest.mark.parametrize(("entropy", "rises"), [(-3.0, True), (-1.0, False)])
def test_alpha_rises_while_there_is_too_little_entropy(entropy, rises):
    log_alpha = torch.tensor(-1.0, requires_grad=True)
    alpha_loss(log_alpha, torch.full((4,), -entropy), action_dim=2).backward()
    assert (log_alpha.grad < 0) == rises


def test_infonce_of_a_hand_made_matrix():
    anchor, positive = torch.eye(3), torch.tensor([[2.0, 0, 1], [0, 3, 0], [1, 1, 1]])
    bilinear = torch.diag(torch.tensor([1.0, 2.0, 3.0]))
    logits = torch.tensor([[2.0, 0, 1], [0, 6, 2], [3, 0, 3]])  # anchor i's similarity to positive j
    expected = F.cross_entropy(logits, torch.arange(3))
    assert contrastive_loss(anchor, positive, bilinear).item() == pytest.approx(expected.item())


def test_targets_move_by_tau():
    slow, fast = torch.nn.Linear(3, 2), torch.nn.Linear(3, 2)
    before, aim = slow.weight.detach().clone(), fast.weight.detach().clone()
    move_towards(slow, fast, 0.05)
    torch.testing.assert_close(slow.weight, 0.95 * before + 0.05 * aim)
    torch.testing.assert_close(fast.weight, aim)


def test_the_actor_sends_nothing_back_into_the_convolutions():
    critic, actor = Critic(SMALL, (16, 16), 4, 2), Actor(SMALL, (16, 16), 4, 2)
    convolved = critic.encoder.convolve(torch.rand(3, 3, 3, 16, 16))
    action, log_prob = actor(convolved, torch.randn(3, 4)).rsample(torch.Generator().manual_seed(0))
    (action.sum() + log_prob.sum()).backward()
    assert all(p.grad is None for p in critic.parameters())
    assert all(p.grad is not None for p in actor.parameters())


def test_the_policys_spread_stays_within_its_limits():
    actor = Actor(SMALL, (16, 16), 4, 2)
    with torch.no_grad():
        actor.mlp[-1].bias[2:] = torch.tensor([100.0, -100.0])
        log_std = actor(torch.zeros(1, 4), torch.zeros(1, 4)).log_std
    torch.testing.assert_close(log_std, torch.tensor([[2.0, -10.0]]))


def test_convolutions_begin_orthogonal_in_their_middle():
    weight = PixelEncoder(SMALL, (16, 16)).convs[2].weight
    middle = weight[:, :, 1, 1]
    torch.testing.assert_close(middle @ middle.T, 2 * torch.eye(4), rtol=0, atol=1e-5)
    assert weight.abs().sum().item() == pytest.approx(middle.abs().sum().item())
