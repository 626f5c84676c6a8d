import dataclasses
import json

import numpy as np
import pytest
import torch
from full_disk import largest_file

from agent.models.rssm import Latent
from agent.systems.agent import Agent
from agent.systems.langwm import resolve
from pretrain.mae import LanguageGroundedMAE


@pytest.fixture
def agent(model, frozen_config, spaces):
    return Agent(model, resolve(frozen_config, model), spaces)


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
        predicted = agent.model.world_model.rssm.imagine_step(
            Latent(**before["latent"]), before["action"], torch.Generator()
        )
    torch.testing.assert_close(after["latent"]["deter"], predicted.deter)


def test_a_state_survives_a_checkpoint(agent, make_room, tmp_path):
    _, state = play(agent, make_room(), 3)
    torch.save(state, tmp_path / "state.pt")
    again = torch.load(tmp_path / "state.pt", weights_only=True)
    first, second = (play(agent, make_room(), 3, dict(s), explore=True)[0] for s in (state, again))
    np.testing.assert_array_equal(first, second)
    assert again["step"] == 3


def test_saved_agent_acts_the_same(agent, make_room, tmp_path):
    agent.save_pretrained(tmp_path / "model")
    for folder in (tmp_path, tmp_path / "model"):
        loaded = Agent.from_pretrained(folder)
        assert loaded.env == agent.env
        np.testing.assert_array_equal(play(agent, make_room(), 4)[0], play(loaded, make_room(), 4)[0])


def test_a_saved_agent_forgets_where_things_lay(agent, tmp_path):
    config = agent.config
    env = dataclasses.replace(config.env, scenes=dataclasses.replace(config.env.scenes, baked="somewhere"))
    Agent(agent.model, dataclasses.replace(config, env=env), agent.spaces).save_pretrained(tmp_path)
    loaded = Agent.from_pretrained(tmp_path)
    assert (loaded.env, loaded.config.mae) == (config.env, None)
    assert "somewhere" not in (tmp_path / "config.json").read_text()


def test_a_folder_without_an_agent_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no trained agent"):
        Agent.from_pretrained(tmp_path)


def test_an_autoencoder_is_no_agent_and_an_agent_no_autoencoder(agent, tiny_mae, tmp_path):
    tiny_mae.save_pretrained(tmp_path / "mae/model")
    with pytest.raises(ValueError, match="/mae/model' holds an autoencoder of pretrain-mae, not a trained"):
        Agent.from_pretrained(tmp_path / "mae")
    agent.save_pretrained(tmp_path / "agent/model")
    with pytest.raises(ValueError, match="/agent/model' holds an agent of train-agent, not a pretrained"):
        LanguageGroundedMAE.from_pretrained(tmp_path / "agent")


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


def test_weights_of_another_agent_are_refused(agent, tmp_path):
    agent.save_pretrained(tmp_path)
    path = tmp_path / "config.json"
    held = json.loads(path.read_text())
    held["config"]["world_model"]["rssm"]["deter"] = 24
    path.write_text(json.dumps(held))
    with pytest.raises(ValueError, match=r"does not fit config\.json"):
        Agent.from_pretrained(tmp_path)
    held["config"]["system"] = "mind-reading"
    path.write_text(json.dumps(held))
    with pytest.raises(ValueError, match=r"does not describe a trained agent.*mind-reading"):
        Agent.from_pretrained(tmp_path)


def test_frames_of_another_size_are_refused(agent, make_room):
    obs, _ = make_room().reset(seed=0)
    with pytest.raises(ValueError, match=r"has shape \(8, 8, 3\); this agent was trained on \(16, 16, 3\)"):
        agent.act(obs | {"rgb": np.zeros((8, 8, 3), np.uint8)})


def test_what_the_system_refuses_to_write_leaves_the_old_agent(agent, tmp_path):
    folder = tmp_path / "agent"
    agent.save_pretrained(folder)
    with largest_file(10_000), pytest.raises(OSError, match="File too large"):
        agent.save_pretrained(folder)
    assert Agent.from_pretrained(folder).system == "langwm"
    assert len(list(folder.iterdir())) == 2
