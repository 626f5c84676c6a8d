import dataclasses
import json

import numpy as np
import pytest
import torch

from agent.config import EnvConfig
from agent.systems.langwm import Agent, AgentState, LanGWM


@pytest.fixture
def agent(tiny_mae, tiny_config):
    torch.manual_seed(0)
    model = LanGWM(tiny_mae, tiny_config.world_model, tiny_config.behavior, action_dim=2)
    return Agent(model.eval(), tiny_config.env)


def play(agent, env, steps, state=None, **kwargs):
    obs, _ = env.reset(seed=0)
    actions = []
    for _ in range(steps):
        action, state = agent.act(obs, state, **kwargs)
        actions.append(action)
        obs, *_ = env.step(action)
    return np.stack(actions), state


def test_acting_repeats_itself(agent, make_room):
    first, _ = play(agent, make_room(), 5)
    second, _ = play(agent, make_room(), 5)
    np.testing.assert_array_equal(first, second)
    assert np.abs(first).max() <= 1


def test_exploring_depends_on_the_seed_of_the_state(agent, make_room):
    first, _ = play(agent, make_room(), 5, agent.initial_state(1), explore=True)
    again, _ = play(agent, make_room(), 5, agent.initial_state(1), explore=True)
    other, _ = play(agent, make_room(), 5, agent.initial_state(2), explore=True)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01


def test_the_action_taken_leads_to_the_next_state(agent, make_room):
    obs, _ = make_room().reset(seed=0)
    _, before = agent.act(obs)
    _, after = agent.act(obs, before)
    with torch.no_grad():
        predicted = agent.model.world_model.rssm.imagine_step(before.latent, before.action, torch.Generator())
    torch.testing.assert_close(after.latent.deter, predicted.deter)


def test_a_state_survives_a_checkpoint(agent, make_room):
    _, state = play(agent, make_room(), 3)
    again = AgentState.from_dict(state.to_dict())
    assert (again.seed, again.step) == (state.seed, 3)
    torch.testing.assert_close(again.latent.feat, state.latent.feat)


def test_saved_agent_acts_the_same(agent, make_room, tmp_path):
    agent.save_pretrained(tmp_path / "model")
    for folder in (tmp_path, tmp_path / "model"):
        loaded = Agent.from_pretrained(folder)
        assert loaded.env == agent.env
        np.testing.assert_array_equal(play(agent, make_room(), 4)[0], play(loaded, make_room(), 4)[0])


def test_a_saved_agent_forgets_where_its_scenes_were_read(agent, tmp_path):
    scenes = dataclasses.replace(agent.env.scenes, baked="somewhere")
    Agent(agent.model, dataclasses.replace(agent.env, scenes=scenes)).save_pretrained(tmp_path)
    assert Agent.from_pretrained(tmp_path).env == agent.env


def test_a_folder_without_an_agent_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no trained agent"):
        Agent.from_pretrained(tmp_path)


def test_a_damaged_agent_is_refused(agent, tmp_path):
    agent.save_pretrained(tmp_path)
    path = tmp_path / "config.json"
    good = json.loads(path.read_text())
    path.write_text(json.dumps(good | {"schema_version": 9}))
    with pytest.raises(ValueError, match="schema version 9"):
        Agent.from_pretrained(tmp_path)
    path.write_text("{}")
    with pytest.raises(ValueError, match="does not describe a trained agent"):
        Agent.from_pretrained(tmp_path)
    path.write_text(json.dumps(good))
    (tmp_path / "model.safetensors").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="cannot be read"):
        Agent.from_pretrained(tmp_path)


def test_frames_of_another_size_are_refused(agent, make_room):
    obs, _ = make_room().reset(seed=0)
    with pytest.raises(ValueError, match="frames of shape"):
        agent.act(obs | {"rgb": np.zeros((8, 8, 3), np.uint8)})


def test_sizes_of_the_paper(tiny_mae):
    """81 visual tokens and one task token; the state is 32 x 32 + 1024 wide."""
    from agent.config import BehaviorConfig, WorldModelConfig
    from pretrain.config import MAEConfig

    assert 1 + MAEConfig().num_patches + 1 == 82
    model = LanGWM(tiny_mae, WorldModelConfig(), BehaviorConfig(), action_dim=2)
    assert model.world_model.rssm.feat_dim == 32 * 32 + 1024
    assert model.behavior.actor[0].out_features == 400
    assert dataclasses.asdict(EnvConfig())["max_steps"] == 500
