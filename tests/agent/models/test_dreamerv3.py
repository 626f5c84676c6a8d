"""What the preset of that name adds, beside torch.distributions and plain loops."""

import dataclasses

import numpy as np
import pytest
import torch
from torch.distributions import Categorical, Independent, kl_divergence

from agent.config import BehaviorConfig, MLPConfig, RSSMConfig
from agent.models.actor_critic import ActorCritic, Imagination, actor_loss, critic_loss
from agent.models.distributions import mix_uniform
from agent.models.return_scale import ReturnScale
from agent.models.rssm import RSSM, balanced_kl
from agent.systems.registry import load_agent_config


def logits(*shape, seed=0):
    return 2 * torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def test_a_mixture_with_the_uniform_distribution_has_its_probabilities():
    mixed = mix_uniform(logits(3, 4, 5), 0.01)
    expected = 0.99 * Categorical(logits=logits(3, 4, 5)).probs + 0.01 / 5
    torch.testing.assert_close(Categorical(logits=mixed).probs, expected)
    certain = mix_uniform(torch.tensor([[[100.0, 0.0, 0.0, -100.0]]]), 0.01)
    torch.testing.assert_close(certain.softmax(-1).min(), torch.tensor(0.0025))
    assert mix_uniform(certain, 0.0) is certain


def test_latents_are_mixed_wherever_they_come_from():
    """In the posterior, the prior and imagination, and so in acting."""
    torch.manual_seed(0)
    config = RSSMConfig(num_latents=4, num_classes=5, deter=16, hidden=12, unimix=0.2)
    rssm = RSSM(config, embed_dim=6, action_dim=2)
    with torch.no_grad():
        for linear in (rssm.post_out, rssm.prior_head[-1]):
            linear.weight.mul_(100)
    embed, action = torch.randn(3, 2, 6), torch.randn(3, 2, 2)
    is_first = torch.zeros(3, 2, dtype=torch.bool)
    post, prior = rssm.observe(embed, action, is_first, rssm.initial(3), torch.Generator().manual_seed(0))
    imagined = rssm.imagine_step(post.at(0), action[:, 1], torch.Generator().manual_seed(0))
    for logit in (post.logit, prior, imagined.logit):
        probability = logit.detach().softmax(-1)
        assert probability.min() == pytest.approx(0.04, abs=1e-5)
        assert probability.max() <= 0.84 + 1e-5
    torch.testing.assert_close(imagined.logit, prior[:, 1])


def test_the_preset_scales_kl_above_one_nat_a_step_by_1_and_a_tenth():
    config = load_agent_config("langwm", presets=["dreamerv3"]).world_model
    post = logits(6, 4, 5, seed=1) * torch.linspace(0, 1, 6)[:, None, None]
    prior = logits(6, 4, 5, seed=2) * torch.linspace(0, 1, 6)[:, None, None]
    post.requires_grad_()
    prior.requires_grad_()
    loss, _ = balanced_kl(post, prior, balance=config.kl_balance, free_nats=config.free_nats)

    def kl(p, q):
        return kl_divergence(*(Independent(Categorical(logits=x), 1) for x in (p, q)))

    dyn, rep = kl(post.detach(), prior), kl(post, prior.detach())
    assert ((dyn < 1).any(), (dyn > 1).any()) == (True, True)
    expected = 1.0 * dyn.clamp(min=1) + 0.1 * rep.clamp(min=1)
    torch.testing.assert_close(config.loss_scales.kl * loss, expected)
    ours = torch.autograd.grad(config.loss_scales.kl * loss.sum(), (post, prior))
    for a, b in zip(ours, torch.autograd.grad(expected.sum(), (post, prior)), strict=True):
        torch.testing.assert_close(a, b)


def test_the_scale_of_returns_is_a_running_mean_of_their_percentiles():
    scale, spread = ReturnScale(), 0.0
    rng = np.random.default_rng(0)
    for size in (0.1, 300.0, 40.0):
        returns = rng.normal(scale=size, size=(40, 15)).astype(np.float32)
        low, high = np.percentile(returns, [5, 95])
        spread = 0.99 * spread + 0.01 * (high - low)
        assert scale.follow(torch.from_numpy(returns)).item() == pytest.approx(max(1, spread), rel=1e-4)
    assert spread > 1


def imagination():
    generator = torch.Generator().manual_seed(0)
    reward, discount, value, entropy = torch.rand(4, 6, 3, generator=generator).unbind(0)
    reward = (100 * reward).requires_grad_()
    feat, action = torch.zeros(6, 3, 24), torch.zeros(6, 3, 2)
    return Imagination(
        feat=feat, action=action, entropy=entropy, reward=reward, discount=discount, next_value=value
    )


def test_scaled_returns_scale_the_actor_but_not_its_entropy_nor_the_critics_targets():
    imagined, config = imagination(), BehaviorConfig(entropy_scale=0.3)
    scale = ReturnScale()
    scale.spread.fill_(50.0)
    plain, returns, weight = actor_loss(imagined, torch.ones(6), config)
    scaled, same_returns, _ = actor_loss(imagined, torch.ones(6), config, scale)
    bonus = 0.3 * (weight * imagined.entropy).mean()
    torch.testing.assert_close(scaled + bonus, (plain + bonus) / scale.spread)
    assert torch.equal(returns, same_returns)
    (a,), (b,) = (torch.autograd.grad(loss, imagined.reward) for loss in (scaled, plain))
    torch.testing.assert_close(a, b / scale.spread)


@pytest.fixture
def behavior():
    torch.manual_seed(0)
    net = MLPConfig(layers=1, units=16)
    config = BehaviorConfig(actor=net, critic=net, value_transform="twohot", return_scale="percentile")
    return ActorCritic(config, 24, 2)


def test_a_two_hot_critic_begins_at_zero_and_learns_the_returns(behavior):
    feat, returns = torch.randn(8, 3, 24), 10 * torch.randn(8, 3)
    assert torch.equal(behavior.value(feat), torch.zeros(8, 3))
    assert torch.equal(behavior.slow_value(feat), torch.zeros(8, 3))
    optimizer = torch.optim.Adam(behavior.critic.parameters(), lr=1e-2)
    for _ in range(200):
        loss = critic_loss(behavior, feat, returns, torch.ones(8, 3))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert (behavior.value(feat) - returns).abs().mean() < 0.3
    assert all(p.grad is None for p in behavior.slow_critic.parameters())


def test_the_spread_of_returns_is_saved_with_the_weights(behavior):
    behavior.return_scale.follow(100 * torch.randn(8, 3))
    assert behavior.state_dict()["return_scale.spread"] > 0
    plain = ActorCritic(dataclasses.replace(behavior.config, return_scale="none"), 24, 2)
    assert not any("return_scale" in name for name in plain.state_dict())
