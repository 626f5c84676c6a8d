import copy
import dataclasses
import math

import pytest
import torch

from agent.replay import ReplayBatch
from agent.systems import langwm
from agent.systems.learner import DreamerLearner


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


@pytest.fixture
def make_learner(frozen_config, spaces):
    def make(**changes):
        config = dataclasses.replace(frozen_config, **changes)
        model = langwm.create(config, spaces)
        return model, DreamerLearner(model, config)

    return make


def snapshot(module):
    return {name: value.clone() for name, value in module.state_dict().items()}


def changed(module, before):
    return {name for name, value in module.state_dict().items() if not torch.equal(value, before[name])}


def test_an_update_moves_everything_but_the_mae(make_learner):
    model, learner = make_learner()
    before = snapshot(model)
    metrics = learner.update_on(make_batch(), 0)
    moved = changed(model, before)
    assert not any(name.startswith("perception.") for name in moved)
    assert not any("slow_critic" in name for name in moved)
    for part in ("world_model.observation", "world_model.rssm", "behavior.actor", "behavior.critic"):
        assert any(name.startswith(part) for name in moved), part
    assert {"wm/loss", "wm/grad_norm", "behavior/actor_loss", "behavior/critic_grad_norm"} <= metrics.keys()


def test_same_update_number_gives_the_same_numbers(make_learner):
    results = []
    for _ in range(2):
        torch.rand(3)  # the global state must not matter
        _, learner = make_learner()
        results.append(learner.update_on(make_batch(), 7))
    assert results[0] == results[1]


def test_optimizers_go_on_where_they_were(make_learner):
    model, learner = make_learner()
    learner.update_on(make_batch(), 0)
    weights, state = snapshot(model), copy.deepcopy(learner.state_dict())
    other, resumed = make_learner()
    other.load_state_dict(weights)
    resumed.load_state_dict(state)
    assert learner.update_on(make_batch(), 1) == resumed.update_on(make_batch(), 1)


def test_slow_critic_follows_at_its_interval(make_learner):
    model, learner = make_learner()
    for index in range(3):
        learner.update_on(make_batch(), index)
        assert changed(model.behavior.slow_critic, model.behavior.critic.state_dict())
    learner.update_on(make_batch(), 3)
    assert not changed(model.behavior.slow_critic, model.behavior.critic.state_dict())


def test_bf16_gives_nearly_the_same_losses(make_learner):
    _, full = make_learner()
    _, half = make_learner(precision="bf16")
    a, b = full.update_on(make_batch(), 0), half.update_on(make_batch(), 0)
    assert b["wm/loss"] == pytest.approx(a["wm/loss"], rel=0.05)


def test_a_loss_that_is_not_finite_is_refused(make_learner):
    _, learner = make_learner()
    batch = dataclasses.replace(make_batch(), reward=torch.full((3, 5), float("nan")))
    with pytest.raises(FloatingPointError, match="the loss is nan at step 0"):
        learner.update_on(batch, 0)


def test_all_of_dreamerv3s_additions_learn_together(make_learner, frozen_config):
    world_model, behavior = frozen_config.world_model, frozen_config.behavior
    rssm = dataclasses.replace(world_model.rssm, unimix=0.01)
    quick = {"rssm": rssm, "reward_transform": "twohot", "free_nats": 1.0, "learning_rate": 3e-3}
    scaled = {"value_transform": "twohot", "return_scale": "percentile", "critic_learning_rate": 3e-3}
    model, learner = make_learner(
        world_model=dataclasses.replace(world_model, **quick),
        behavior=dataclasses.replace(behavior, **scaled),
    )
    history = [learner.update_on(make_batch(), index) for index in range(60)]
    assert history[0]["wm/reward_loss"] == pytest.approx(math.log(255), rel=1e-5)
    assert history[-1]["wm/reward_loss"] < history[0]["wm/reward_loss"] - 0.5
    critic = [metrics["behavior/critic_loss"] for metrics in history]
    late = sum(critic[-10:]) / 10  # its targets move as the rewards are learned: first they run away from it
    assert late < critic[0]
    assert late < max(critic) - 0.5
    assert model.behavior.return_scale.spread == history[-1]["behavior/return_spread"] > 0
