import copy
import dataclasses

import pytest
import torch

from agent.replay import ReplayBatch
from agent.systems.langwm import LanGWM
from agent.systems.learner import Learner


def make_batch(batch=3, length=5):
    generator = torch.Generator().manual_seed(0)
    is_first = torch.zeros(batch, length, dtype=torch.bool)
    is_first[:, 0] = True
    nothing = torch.zeros(batch, length, dtype=torch.bool)
    return ReplayBatch(
        rgb=torch.randint(0, 256, (batch, length, 16, 16, 3), generator=generator, dtype=torch.uint8),
        depth=torch.ones(batch, length, 16, 16),
        task=torch.randn(batch, length, 4, generator=generator),
        action=torch.rand(batch, length, 2, generator=generator) * 2 - 1,
        reward=torch.randn(batch, length, generator=generator),
        is_first=is_first,
        is_last=nothing,
        is_terminal=nothing,
        objects=[[[] for _ in range(length)] for _ in range(batch)],
    )


def make_learner(mae, config):
    torch.manual_seed(0)
    model = LanGWM(mae, config.world_model, config.behavior, action_dim=2)
    return model, Learner(model, config)


def snapshot(module):
    return {name: value.clone() for name, value in module.state_dict().items()}


def changed(module, before):
    return {name for name, value in module.state_dict().items() if not torch.equal(value, before[name])}


def test_an_update_moves_everything_but_the_mae(tiny_mae, tiny_config):
    model, learner = make_learner(tiny_mae, tiny_config)
    before = snapshot(model)
    metrics = learner.update(make_batch(), 0)
    moved = changed(model, before)
    assert not any(name.startswith("mae.") for name in moved)
    assert not any("slow_critic" in name for name in moved)
    for part in ("world_model.encoder", "world_model.rssm", "behavior.actor", "behavior.critic"):
        assert any(name.startswith(part) for name in moved), part
    assert {"wm/loss", "wm/grad_norm", "behavior/actor_loss", "behavior/critic_grad_norm"} <= metrics.keys()


def test_same_update_number_gives_the_same_numbers(tiny_mae, tiny_config):
    results = []
    for _ in range(2):
        torch.rand(3)  # the global state must not matter
        _, learner = make_learner(tiny_mae, tiny_config)
        results.append(learner.update(make_batch(), 7))
    assert results[0] == results[1]


def test_optimizers_go_on_where_they_were(tiny_mae, tiny_config):
    model, learner = make_learner(tiny_mae, tiny_config)
    learner.update(make_batch(), 0)
    weights, state = snapshot(model), copy.deepcopy(learner.state_dict())
    other, resumed = make_learner(tiny_mae, tiny_config)
    other.load_state_dict(weights)
    resumed.load_state_dict(state)
    assert learner.update(make_batch(), 1) == resumed.update(make_batch(), 1)


def test_slow_critic_follows_at_its_interval(tiny_mae, tiny_config):
    model, learner = make_learner(tiny_mae, tiny_config)
    for index in range(3):
        learner.update(make_batch(), index)
        assert changed(model.behavior.slow_critic, model.behavior.critic.state_dict())
    learner.update(make_batch(), 3)
    assert not changed(model.behavior.slow_critic, model.behavior.critic.state_dict())


def test_bf16_gives_nearly_the_same_losses(tiny_mae, tiny_config):
    _, full = make_learner(tiny_mae, tiny_config)
    _, half = make_learner(tiny_mae, dataclasses.replace(tiny_config, precision="bf16"))
    a, b = full.update(make_batch(), 0), half.update(make_batch(), 0)
    assert b["wm/loss"] == pytest.approx(a["wm/loss"], rel=0.05)


def test_a_loss_that_is_not_finite_is_refused(tiny_mae, tiny_config):
    _, learner = make_learner(tiny_mae, tiny_config)
    batch = dataclasses.replace(make_batch(), reward=torch.full((3, 5), float("nan")))
    with pytest.raises(FloatingPointError, match="the loss is nan at step 0"):
        learner.update(batch, 0)
