import dataclasses

import numpy as np
import pytest
import torch

from agent import Agent, train_agent
from agent.systems import own_encoder
from agent.systems.own_encoder import CheckedEncoder
from agent.systems.registry import find_system
from langwm_data.config_io import ConfigError
from pretrain.metrics import read_metrics


class Patches:
    """As a user would write one: the mean colour of each quarter."""

    def __init__(self):
        self.calls = 0

    def encode(self, rgb):
        self.calls += 1
        halves = rgb.float().unflatten(1, (2, -1)).unflatten(3, (2, -1)) / 255
        return halves.mean((2, 4)).flatten(1, 2)


class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.convolution = torch.nn.Conv2d(3, 5, 8, 8)

    def encode(self, rgb):
        return self.convolution(rgb.permute(0, 3, 1, 2) / 255).flatten(2).transpose(1, 2)


@pytest.fixture
def config(tiny_config):
    return dataclasses.replace(tiny_config, system="own-encoder", features="frozen")


def losses(run):
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(run)]


def test_an_encoder_of_the_users_own_learns_is_handed_on_and_goes_on(config, make_room, tmp_path):
    encoder = Patches()
    run = train_agent(config, tmp_path / "run", env=make_room(max_steps=9), encoder=encoder)
    assert any("wm/token_loss" in row for row in read_metrics(run))
    for steps in (43, 60):
        part = dataclasses.replace(config, steps=steps)
        train_agent(part, tmp_path / "parts", env=make_room(max_steps=9), encoder=Patches())
    assert losses(tmp_path / "parts") == losses(run)
    obs, _ = make_room().reset(seed=0)
    actions = [Agent.from_pretrained(run, encoder=Patches()).act(obs)[0] for _ in range(2)]
    np.testing.assert_array_equal(*actions)


def test_frames_are_encoded_once(config, make_room, tmp_path):
    """The room's camera shows one and the same picture; the black frame is the check at the start."""
    encoder = Patches()
    train_agent(config, tmp_path, env=make_room(max_steps=9), encoder=encoder)
    assert encoder.calls == 2


def test_the_weights_of_a_network_are_neither_trained_nor_saved(config, make_room, tmp_path):
    encoder = Network()
    before = encoder.convolution.weight.detach().clone()
    run = train_agent(config, tmp_path, env=make_room(max_steps=9), encoder=encoder)
    assert torch.equal(encoder.convolution.weight, before)
    assert encoder.convolution.weight.grad is None
    weights = Agent.from_pretrained(run, encoder=encoder).model.state_dict()
    assert not any(name.startswith("perception") for name in weights)


def test_a_missing_encoder_is_refused(config, make_room, tmp_path):
    match = r"system 'own-encoder' needs encoder=\.\.\.; .*train_agent\(config, out, encoder=\.\.\.\)"
    with pytest.raises(ConfigError, match=match):
        train_agent(config, tmp_path / "run", env=make_room())
    assert not (tmp_path / "run").exists()
    run = train_agent(config, tmp_path / "run", env=make_room(max_steps=9), encoder=Patches())
    with pytest.raises(ValueError, match=match):
        Agent.from_pretrained(run)


def test_an_encoder_for_another_system_is_refused(tiny_config, make_room, tmp_path):
    with pytest.raises(ConfigError, match="system 'langwm' takes no encoder"):
        train_agent(tiny_config, tmp_path, env=make_room(), encoder=Patches())


def test_an_encoder_of_other_sizes_does_not_fit_the_agent(config, make_room, tmp_path):
    run = train_agent(config, tmp_path, env=make_room(max_steps=9), encoder=Patches())
    with pytest.raises(ValueError, match=r"does not fit config\.json"):
        Agent.from_pretrained(run, encoder=Network())


@pytest.mark.parametrize("changes", [{"features": "finetuned"}, {"mae": "somewhere"}])
def test_nothing_is_learned_of_it(changes, config, spaces):
    system = find_system("own-encoder", Patches())
    with pytest.raises(ConfigError, match="it goes with features 'frozen' and no --mae"):
        system.create(dataclasses.replace(config, **changes), spaces)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((1, 4, 3)), r"gave <class 'numpy.ndarray'>; wanted a tensor of floats \(1, N, D\)"),
        (torch.zeros(1, 4, 3, dtype=torch.int64), r"gave torch.int64 \(1, 4, 3\); wanted a tensor of floats"),
        (torch.zeros(1, 12), r"gave torch.float32 \(1, 12\); wanted a tensor of floats \(1, N, D\)"),
        (torch.zeros(2, 4, 3), r"gave \(2, 4, 3\); wanted \(1, N, D\)"),
        (torch.full((1, 4, 3), 1e6), "not finite in half precision"),
    ],
)
def test_an_encoder_that_gives_something_else_is_refused(given, message):
    class Wrong:
        def encode(self, rgb):
            return given

    with pytest.raises(ValueError, match=message):
        CheckedEncoder(Wrong(), "cpu", 16, 16)


def test_an_encoder_that_changes_its_mind_is_refused():
    class Growing:
        count = 2

        def encode(self, rgb):
            self.count += 1
            return torch.zeros(len(rgb), self.count, 4)

    checked = CheckedEncoder(Growing(), "cpu", 16, 16)
    with pytest.raises(ValueError, match=r"gave \(2, 4, 4\); wanted \(2, 3, 4\)"):
        checked.encode(torch.zeros(2, 16, 16, 3, dtype=torch.uint8))


def test_its_name_is_the_one_that_is_configured():
    assert find_system(own_encoder.NAME, Patches()).note
