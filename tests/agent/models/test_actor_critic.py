import pytest
import torch

from agent.config import BehaviorConfig, MLPConfig, PoolingConfig, RSSMConfig, TaskConfig, WorldModelConfig
from agent.models.actor_critic import ActorCritic, Imagination, actor_loss, critic_loss, imagine
from agent.models.encoder import TokenModel
from agent.models.nets import frozen
from agent.models.rssm import Latent
from agent.models.world_model import WorldModel

CONFIG = BehaviorConfig(
    imag_horizon=4, actor=MLPConfig(layers=1, units=16), critic=MLPConfig(layers=1, units=16)
)
BATCH = 3


@pytest.fixture
def model():
    torch.manual_seed(0)
    config = WorldModelConfig(
        pooling=PoolingConfig(dim=8, num_heads=2, num_layers=1, mlp_ratio=2),
        rssm=RSSMConfig(num_latents=4, num_classes=4, deter=8, hidden=8),
        head=MLPConfig(layers=1, units=8),
        task=TaskConfig(layers=1, units=8, scale=(5.0, 3.14, 0.5, 1.57)),
    )
    return WorldModel(config, TokenModel(config, num_tokens=2, token_dim=4, task_dim=4), action_dim=2)


@pytest.fixture
def behavior(model):
    torch.manual_seed(1)
    return ActorCritic(CONFIG, model.rssm.feat_dim, 2)


def start_state():
    generator = torch.Generator().manual_seed(0)
    logit = torch.randn(BATCH, 4, 4, generator=generator)
    return Latent(torch.randn(BATCH, 8, generator=generator), logit.softmax(-1), logit)


def imagine_frozen(model, behavior, seed=0):
    with frozen(model):
        return imagine(model, behavior, start_state(), torch.Generator().manual_seed(seed))


def test_imagined_returns_agree_with_a_plain_loop(model, behavior):
    imagined = imagine_frozen(model, behavior)
    _, returns, weight = actor_loss(imagined, torch.ones(BATCH), CONFIG)
    for row in range(BATCH):
        later, alive, weights = imagined.next_value[row, -1].item(), 1.0, []
        expected = []
        for t in reversed(range(CONFIG.imag_horizon)):
            reward, discount = imagined.reward[row, t].item(), imagined.discount[row, t].item()
            value = imagined.next_value[row, t].item()
            later = reward + discount * ((1 - CONFIG.lambda_) * value + CONFIG.lambda_ * later)
            expected.insert(0, later)
        for t in range(CONFIG.imag_horizon):
            weights.append(alive)
            alive *= imagined.discount[row, t].item()
        assert returns[row].tolist() == pytest.approx(expected, rel=1e-4)
        assert weight[row].tolist() == pytest.approx(weights, rel=1e-4)


def test_imagination_follows_the_prior(model, behavior):
    imagined = imagine_frozen(model, behavior)
    state, generator = start_state(), torch.Generator().manual_seed(0)
    for t in range(CONFIG.imag_horizon):
        torch.testing.assert_close(imagined.feat[:, t], state.feat)
        action = behavior.policy(state.feat).rsample(generator)
        torch.testing.assert_close(imagined.action[:, t], action)
        state = model.rssm.imagine_step(state, action, generator)
        torch.testing.assert_close(imagined.reward[:, t], model.predict_reward(state.feat))


def test_actor_learns_through_the_dynamics_and_the_world_model_does_not(model, behavior):
    loss, _, _ = actor_loss(imagine_frozen(model, behavior), torch.ones(BATCH), CONFIG)
    loss.backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in behavior.actor.parameters())
    assert all(p.grad is None for p in model.parameters())
    assert all(p.grad is None for p in behavior.slow_critic.parameters())


def constructed(discount, horizon=2):
    ones = torch.ones(1, horizon)
    return Imagination(
        feat=torch.zeros(1, horizon, 24),
        action=torch.zeros(1, horizon, 2),
        entropy=0 * ones,
        reward=torch.tensor([[0.0, 10.0]]),
        discount=torch.tensor([discount]),
        next_value=5 * ones,
    )


def test_timeout_bootstraps_and_success_does_not():
    _, success, _ = actor_loss(constructed([0.99, 0.0]), torch.ones(1), CONFIG)
    _, timeout, _ = actor_loss(constructed([0.99, 0.99]), torch.ones(1), CONFIG)
    assert success[0, 1] == 10
    assert timeout[0, 1] == pytest.approx(10 + 0.99 * 5)


def test_starting_from_a_terminal_state_teaches_nothing(model, behavior):
    imagined = imagine_frozen(model, behavior)
    loss, returns, weight = actor_loss(imagined, torch.zeros(BATCH), CONFIG)
    assert loss.item() == 0
    assert critic_loss(behavior, imagined.feat, returns, weight).item() == 0


def test_entropy_bonus_is_scaled(model, behavior):
    imagined = imagine_frozen(model, behavior)
    loud = BehaviorConfig(entropy_scale=0.5, imag_horizon=4)
    still = BehaviorConfig(entropy_scale=0.0, imag_horizon=4)
    with_bonus, _, weight = actor_loss(imagined, torch.ones(BATCH), loud)
    without, _, _ = actor_loss(imagined, torch.ones(BATCH), still)
    torch.testing.assert_close(without - with_bonus, 0.5 * (weight * imagined.entropy).mean())


def test_critic_learns_the_returns_and_only_the_critic(model, behavior):
    imagined = imagine_frozen(model, behavior)
    _, returns, weight = actor_loss(imagined, torch.ones(BATCH), CONFIG)
    optimizer = torch.optim.Adam(behavior.critic.parameters(), lr=1e-2)
    first = critic_loss(behavior, imagined.feat, returns, weight).item()
    for _ in range(100):
        loss = critic_loss(behavior, imagined.feat, returns, weight)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.05 * first
    assert all(p.grad is None for p in behavior.actor.parameters())


def test_slow_critic_moves_only_when_told(behavior):
    with torch.no_grad():
        behavior.critic[-1].bias.add_(3)
    feat = torch.zeros(1, 24)
    assert behavior.value(feat) != behavior.slow_value(feat)
    behavior.copy_to_slow_critic()
    assert behavior.value(feat) == behavior.slow_value(feat)


def test_untrained_policy_explores_the_whole_range(behavior):
    feat = torch.randn(2000, 24, generator=torch.Generator().manual_seed(0))
    action = behavior.policy(feat).rsample(torch.Generator().manual_seed(1))
    assert action.std(0).min() > 0.35
    assert action.abs().max() < 1
