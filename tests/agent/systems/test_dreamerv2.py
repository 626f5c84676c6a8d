import dataclasses

import numpy as np
import pytest
import torch

from agent.config import PixelConfig
from agent.models.pixels import as_pixels, as_rgb
from agent.replay import ReplayBatch
from agent.systems.agent import Agent
from agent.systems.dreamerv2 import PixelPerception
from agent.systems.learner import DreamerLearner
from agent.systems.registry import find_system, load_agent_config
from agent.train import train_agent
from langwm_data.config_io import ConfigError
from pretrain.augment import augment_frame
from pretrain.config import AugmentConfig
from pretrain.metrics import read_metrics

NAMES = ("dreamerv2", "dreamerv2-da", "dreamerv2-oracle-boxes")
VECTOR_DIM = 5


def configure(config, name):
    pixels = PixelConfig(channels=2, is_augmented=name == "dreamerv2-da")
    world_model = dataclasses.replace(config.world_model, pixels=pixels)
    return dataclasses.replace(config, system=name, world_model=world_model)


def make_frames(batch=2, length=3, height=32, width=48):
    rng = np.random.default_rng(0)
    return torch.from_numpy(rng.integers(0, 256, (batch, length, height, width, 3), dtype=np.uint8))


def make_batch(batch=3, length=5):
    generator = torch.Generator().manual_seed(0)
    is_first = torch.zeros(batch, length, dtype=torch.bool)
    is_first[:, 0] = True
    nothing = torch.zeros(batch, length, dtype=torch.bool)
    return ReplayBatch(
        rgb=make_frames(batch, length, 16, 16),
        task=torch.randn(batch, length, 4, generator=generator),
        action=torch.rand(batch, length, 2, generator=generator) * 2 - 1,
        reward=torch.randn(batch, length, generator=generator),
        is_first=is_first,
        is_last=nothing,
        is_terminal=nothing,
        features={"features": torch.randn(batch, length, VECTOR_DIM, generator=generator).half()},
    )


def make(config, name, spaces):
    system, config = find_system(name), configure(config, name)
    model = system.create(config, dataclasses.replace(spaces, feature_dim=VECTOR_DIM))
    learner = system.make_learner(model, config)
    assert isinstance(learner, DreamerLearner)
    return model, learner


@pytest.mark.parametrize("name", NAMES)
def test_an_update_moves_all_weights(name, tiny_config, spaces):
    model, learner = make(tiny_config, name, spaces)
    before = {k: v.clone() for k, v in model.state_dict().items()}
    metrics = learner.update_on(make_batch(), 0)
    after = model.state_dict()
    still = {k for k, v in after.items() if torch.equal(v, before[k])}
    assert {k for k in still if "slow_critic" not in k} == set()
    assert ("wm/vector_loss" if name.endswith("boxes") else "wm/image_loss") in metrics
    assert "wm/token_loss" not in metrics


@pytest.mark.parametrize("name", NAMES)
def test_the_same_update_gives_the_same_numbers(name, tiny_config, spaces):
    results = []
    for _ in range(2):
        torch.rand(3)
        results.append(make(tiny_config, name, spaces)[1].update_on(make_batch(), 7))
    assert results[0] == results[1]


def test_augmentation_changes_what_is_seen_and_not_what_is_told(tiny_config, spaces, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "agent.systems.learner.world_model_loss",
        lambda model, batch, generator: seen.append(batch) or 1 / 0,
    )
    for name in ("dreamerv2", "dreamerv2-da"):
        with pytest.raises(ZeroDivisionError):
            make(tiny_config, name, spaces)[1].update_on(make_batch(), 0)
    plain, augmented = seen
    assert torch.equal(plain.visual, plain.target)
    assert torch.equal(augmented.target, plain.target)
    assert not torch.equal(augmented.visual, augmented.target)


def test_all_frames_of_a_sequence_are_changed_alike_and_sequences_are_not():
    frames = make_frames(1, 1).expand(4, 3, -1, -1, -1)
    perception = PixelPerception(AugmentConfig(padding_px=4))
    changed = perception.augment(as_pixels(frames), torch.Generator().manual_seed(0))
    for row in changed:
        assert torch.equal(row[0], row[1])
        assert torch.equal(row[0], row[2])
    assert len({row[0].numpy().tobytes() for row in changed}) == 4


def test_augmentation_is_that_of_pretraining():
    frames, config = make_frames(1, 2), AugmentConfig(padding_px=4)
    changed = PixelPerception(config).augment(as_pixels(frames), torch.Generator().manual_seed(3))
    seed = int(torch.randint(2**31, (1,), generator=torch.Generator().manual_seed(3)))
    for ours, frame in zip(as_rgb(changed[0]), frames[0].numpy(), strict=True):
        rgb, _, _ = augment_frame(
            np.random.default_rng(seed), frame, np.zeros((32, 48), np.float32), (), config
        )
        np.testing.assert_array_equal(ours.numpy(), rgb)


def test_nothing_is_ever_flipped():
    """A ramp from dark on the left to bright on the right stays one."""
    ramp = torch.linspace(0, 255, 48).to(torch.uint8)[None, None, None, :, None].expand(40, 1, 32, 48, 3)
    changed = PixelPerception(AugmentConfig()).augment(as_pixels(ramp), torch.Generator().manual_seed(0))
    halves = changed.mean((1, 2, 3))
    assert (halves[:, 28:].mean(-1) > halves[:, :20].mean(-1)).all()


@pytest.mark.parametrize(("height", "width"), [(24, 32), (32, 40)])
def test_frames_that_cannot_be_halved_four_times_are_refused(height, width, tiny_config, spaces):
    wanted = rf"env\.camera is {height} x {width} pixels but system 'dreamerv2' needs multiples of 16"
    with pytest.raises(ConfigError, match=wanted):
        find_system("dreamerv2").create(
            configure(tiny_config, "dreamerv2"), dataclasses.replace(spaces, height=height, width=width)
        )


def test_overlays_make_the_systems_what_they_are():
    pixels = {n: load_agent_config(n).world_model.pixels for n in ("dreamerv2", "dreamerv2-da")}
    assert not pixels["dreamerv2"].is_augmented
    assert pixels["dreamerv2-da"].is_augmented
    assert load_agent_config("dreamerv2-oracle-boxes").env.with_labels
    assert not load_agent_config("dreamerv2-grounding-dino").env.with_labels


def losses(run):
    return [{k: v for k, v in row.items() if not k.startswith("time/")} for row in read_metrics(run)]


class Killed(Exception):
    pass


@pytest.mark.parametrize("name", NAMES)
def test_a_run_learns_goes_on_after_a_kill_and_hands_on_an_agent(name, tiny_config, make_room, tmp_path):
    config = dataclasses.replace(configure(tiny_config, name), steps=45)

    def kill(done, total):
        if done == 33:
            raise Killed

    with pytest.raises(Killed):
        train_agent(config, tmp_path / "killed", env=make_room(max_steps=9), progress=kill)
    for run in ("killed", "whole"):
        train_agent(config, tmp_path / run, env=make_room(max_steps=9))
    assert losses(tmp_path / "killed") == losses(tmp_path / "whole")
    assert any("wm/loss" in row for row in losses(tmp_path / "whole"))
    agent = Agent.from_pretrained(tmp_path / "whole")
    env = agent.wrap_env(make_room())
    obs, _ = env.reset(seed=0)
    action, state = agent.act(obs)
    again, _ = Agent.from_pretrained(tmp_path / "killed").act(obs)
    np.testing.assert_array_equal(action, again)
    agent.act(env.step(action)[0], state)


def test_acting_without_the_vector_is_refused(tiny_config, make_room, tmp_path):
    config = dataclasses.replace(configure(tiny_config, "dreamerv2-oracle-boxes"), steps=20)
    train_agent(config, tmp_path / "run", env=make_room(max_steps=9))
    with pytest.raises(ValueError, match=r"obs has no 'features', which system 'dreamerv2-oracle-boxes'"):
        Agent.from_pretrained(tmp_path / "run").act(make_room().reset(seed=0)[0])
