"""CURL and RAD in the empty room."""

import copy
import dataclasses

import numpy as np
import pytest
import torch

from agent.config import SACConfig
from agent.replay import TransitionBatch
from agent.systems.agent import Agent
from agent.systems.registry import load_agent_config
from agent.systems.sac import SYSTEM, SACLearner
from agent.systems.system import Spaces
from agent.train import train_agent
from langwm_data.config_io import ConfigError
from pretrain.metrics import read_metrics

SAC = SACConfig(filters=4, hidden=32, feature_dim=8, batch_size=12)


@pytest.fixture
def make_config(tiny_config):
    def make(name="curl", **sac):
        overlay = load_agent_config(name).sac
        values = {"is_contrastive": overlay.is_contrastive, "data_augs": overlay.data_augs} | sac
        small = dataclasses.replace(SAC, **values)
        return dataclasses.replace(tiny_config, system=name, sac=small, update_every=1)

    return make


def make_batch(size=12):
    g = torch.Generator().manual_seed(0)
    return TransitionBatch(
        rgb=torch.randint(0, 256, (size, 4, 16, 16, 3), dtype=torch.uint8, generator=g),
        task=torch.randn(size, 2, 4, generator=g),
        action=2 * torch.rand(size, 2, generator=g) - 1,
        reward=torch.randn(size, generator=g),
        is_terminal=torch.rand(size, generator=g) < 0.3,
    )


def weights(module):
    return {name: p.detach().clone() for name, p in module.named_parameters()}


def changed(before, module):
    return {name for name, p in module.named_parameters() if not torch.equal(before[name], p)}


def test_overlays_are_what_the_two_systems_differ_by():
    curl, rad = load_agent_config("curl"), load_agent_config("rad")
    assert (curl.sac.is_contrastive, rad.sac.is_contrastive) == (True, False)
    assert curl.update_every == rad.update_every == 1
    for preset in ("debug", "tiny", "paper"):  # what every row is given before it learns
        prefill = load_agent_config("langwm", presets=[preset]).prefill_steps
        assert load_agent_config("curl", presets=[preset]).prefill_steps == prefill
    assert dataclasses.replace(curl.sac, is_contrastive=False) == rad.sac


def test_the_defaults_are_those_of_the_public_code():
    sac = load_agent_config("curl").sac
    assert (sac.batch_size, sac.hidden, sac.feature_dim, sac.filters, sac.frame_stack) == (
        128,
        1024,
        50,
        32,
        3,
    )
    assert (sac.discount, sac.learning_rate, sac.alpha, sac.alpha_learning_rate) == (0.99, 1e-3, 0.1, 1e-4)
    assert (sac.critic_tau, sac.encoder_tau, sac.target_every, sac.actor_every) == (0.01, 0.05, 2, 2)


def test_curl_has_a_bilinear_product_and_rad_has_none(make_config, spaces):
    assert SYSTEM.create(make_config("curl"), spaces).bilinear.shape == (8, 8)
    assert SYSTEM.create(make_config("rad"), spaces).bilinear is None


def test_convolutions_are_shared_and_saved_once(make_config, spaces):
    names = SYSTEM.create(make_config(), spaces).state_dict().keys()
    assert sum("convs.0.weight" in name for name in names) == 2  # of the critic and of its slow copy
    assert not any(name.startswith("actor.") and "conv" in name for name in names)


@pytest.mark.parametrize("name", ["curl", "rad"])
def test_every_loss_trains_what_it_should(name, make_config, spaces):
    config = make_config(name)
    model = SYSTEM.create(config, spaces)
    learner, generator = SACLearner(model, config), torch.Generator().manual_seed(0)
    seen = learner._augment(make_batch(), generator)

    before = weights(model)
    learner._update_critic(seen, generator, 0)
    expected = {n for n in before if n.startswith("critic.")}
    assert changed(before, model) == expected

    before = weights(model)
    learner._update_actor(seen, generator, 0)
    assert changed(before, model) == {n for n in before if n.startswith("actor.")} | {"log_alpha"}

    if name == "curl":
        before = weights(model)
        learner._update_contrast(seen.pixels, seen.pixels, 0)
        found = changed(before, model)
        assert {n for n in found if n.startswith("critic.encoder.")}
        assert found == {n for n in before if n.startswith("critic.encoder.")} | {"bilinear"}


def test_updates_of_actor_and_targets_come_every_second_time(make_config, spaces):
    config = make_config("rad")
    model = SYSTEM.create(config, spaces)
    learner = SACLearner(model, config)
    before = weights(model)
    learner.update_on(make_batch(), 1)
    assert not any(n.startswith(("actor", "target")) for n in changed(before, model))
    before = weights(model)
    learner.update_on(make_batch(), 2)
    found = changed(before, model)
    assert {n for n in before if n.startswith("actor.")} <= found
    name = "values.0.0.weight"
    moved = model.target.get_parameter(name)
    expected = 0.99 * before[f"target.{name}"] + 0.01 * model.critic.get_parameter(name)
    torch.testing.assert_close(moved, expected)
    name = "encoder.convs.0.weight"
    expected = 0.95 * before[f"target.{name}"] + 0.05 * model.critic.get_parameter(name)
    torch.testing.assert_close(model.target.get_parameter(name), expected)


def test_losses_fall_on_one_batch(make_config, spaces):
    config = make_config("curl", critic_tau=0.0, encoder_tau=0.0, alpha=1e-4, alpha_learning_rate=1e-9)
    model = SYSTEM.create(config, spaces)
    learner, batch = SACLearner(model, config), make_batch()
    batch = dataclasses.replace(batch, is_terminal=torch.ones_like(batch.is_terminal))
    rows = [learner.update_on(batch, index) for index in range(150)]
    early, late = (
        {k: np.mean([r[k] for r in part if k in r]) for k in rows[0]} for part in (rows[:5], rows[-10:])
    )
    assert late["sac/critic_loss"] < 0.15 * early["sac/critic_loss"]
    assert late["sac/contrast_loss"] < 0.6 * early["sac/contrast_loss"]
    assert late["sac/actor_loss"] < early["sac/actor_loss"]


def test_an_update_repeats_itself(make_config, spaces):
    config = make_config("curl")
    results = []
    for _ in range(2):
        model = SYSTEM.create(config, spaces)
        learner = SACLearner(model, config)
        results.append([learner.update_on(make_batch(), i) for i in range(3)])
    assert results[0] == results[1]


def test_bf16_learns_nearly_the_same(make_config, spaces):
    config = make_config("curl")
    found = {}
    for precision in ("fp32", "bf16"):
        asked = dataclasses.replace(config, precision=precision)
        found[precision] = SACLearner(SYSTEM.create(asked, spaces), asked).update_on(make_batch(), 0)
    for name in ("sac/critic_loss", "sac/contrast_loss", "sac/entropy"):
        assert found["bf16"][name] == pytest.approx(found["fp32"][name], rel=0.1, abs=0.05)
    assert found["bf16"] != found["fp32"]


def test_acting_stacks_the_last_frames(make_config, spaces):
    model = SYSTEM.create(make_config(), spaces)
    state = model.initial_state(3)
    for step in range(5):
        obs = {"rgb": np.full((16, 16, 3), 10 * step, np.uint8), "task": np.zeros(4, np.float32)}
        action, state = model.act(obs, state, explore=True)
        assert action.shape == (2,)
        assert np.abs(action).max() <= 1
        expected = [max(0, 10 * (step - back)) for back in (2, 1, 0)]
        assert state["frames"][:, 0, 0, 0].tolist() == expected


def test_the_first_frame_fills_the_stack(make_config, spaces):
    model = SYSTEM.create(make_config(), spaces)
    obs = {"rgb": np.full((16, 16, 3), 7, np.uint8), "task": np.zeros(4, np.float32)}
    _, state = model.act(obs, model.initial_state(0), explore=False)
    assert state["frames"].unique().tolist() == [7]


def test_acting_sees_what_learning_sees(make_config, spaces):
    """With nothing augmented, the policy of a stored observation is the policy that acted on it."""
    model = SYSTEM.create(make_config("rad", data_augs=()), spaces)
    learner, batch = SACLearner(model, make_config("rad", data_augs=())), make_batch(1)
    seen = learner._augment(batch, torch.Generator())
    state = model.initial_state(0) | {"frames": batch.rgb[0, :3].roll(1, 0), "step": 9}
    obs = {"rgb": batch.rgb[0, 2].numpy(), "task": batch.task[0, 0].numpy()}
    action, _ = model.act(obs, state, explore=False)
    policy = model.actor(model.critic.encoder.convolve(seen.pixels), seen.task)
    np.testing.assert_allclose(action, policy.mode[0].detach(), atol=1e-6)


def test_the_task_observation_matters_to_actor_and_critic(make_config, spaces):
    model = SYSTEM.create(make_config(), spaces)
    convolved = model.critic.encoder.convolve(torch.rand(2, 3, 3, 16, 16))
    tasks = (torch.zeros(2, 4), torch.ones(2, 4))
    assert not torch.equal(*(model.actor(convolved, t).mode for t in tasks))
    assert not torch.equal(*(model.critic(convolved, t, torch.zeros(2, 2)) for t in tasks))


def test_what_diverges_is_said(make_config, spaces):
    config = make_config("rad")
    learner = SACLearner(SYSTEM.create(config, spaces), config)
    batch = dataclasses.replace(make_batch(), reward=torch.full((12,), float("inf")))
    with pytest.raises(
        FloatingPointError, match=r"the critic loss is .* at update 4 .*learning rate below 0.001"
    ):
        learner.update_on(batch, 4)


def test_frames_too_small_are_refused(make_config):
    with pytest.raises(ConfigError, match=r"env.camera is 12 x 40 pixels, of which 12 x 36 are seen"):
        SYSTEM.create(make_config(), Spaces(12, 40, 4, 2))


def test_another_task_observation_is_refused(make_config):
    config = make_config()
    task = dataclasses.replace(config.world_model.task, scale=(1.0,) * 4)
    config = dataclasses.replace(config, world_model=dataclasses.replace(config.world_model, task=task))
    with pytest.raises(ConfigError, match=r"world_model.task.scale has 4 entries but .* has 3"):
        SYSTEM.create(config, Spaces(16, 16, 3, 2))


def test_augmentations_that_exclude_each_other_are_refused():
    with pytest.raises(
        ConfigError, match=r"sac.data_augs crop, translate: give one of crop, pad_crop, translate"
    ):
        SACConfig(data_augs=("crop", "translate"))
    with pytest.raises(ConfigError, match=r"sac.is_contrastive needs views that differ"):
        SACConfig(is_contrastive=True, data_augs=())


@pytest.mark.parametrize("name", ["curl", "rad"])
def test_a_run_learns_is_killed_goes_on_and_is_handed_on(name, make_config, make_room, tmp_path):
    config = make_config(name)

    def kill(done, total):
        if done == 41:
            raise InterruptedError

    train_agent(config, tmp_path / "whole", env=make_room(max_steps=9))
    with pytest.raises(InterruptedError):
        train_agent(config, tmp_path / "killed", env=make_room(max_steps=9), progress=kill)
    train_agent(config, tmp_path / "killed", env=make_room(max_steps=9))
    whole, killed = (
        [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(tmp_path / run)]
        for run in ("whole", "killed")
    )
    assert whole == killed
    assert "sac/critic_loss" in whole[-1]
    stored = next((tmp_path / "whole" / "replay").glob("episode-*")).stat().st_size
    assert stored < 10 * (16 * 16 * 3 + 100) + 1000  # neither depth nor objects

    agent, again = (Agent.from_pretrained(tmp_path / run) for run in ("whole", "killed"))
    obs, _ = make_room().reset(seed=0)
    np.testing.assert_array_equal(agent.act(obs)[0], again.act(obs)[0])
    state = copy.deepcopy(agent.act(obs)[1])
    torch.save(state, tmp_path / "state.pt")
    loaded = torch.load(tmp_path / "state.pt", weights_only=True)
    first, second = (agent.act(obs, s, explore=True)[0] for s in (state, loaded))
    np.testing.assert_array_equal(first, second)
