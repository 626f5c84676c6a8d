from typing import get_args

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from agent.config import SystemName
from agent.systems.own_encoder import NAME
from agent.systems.registry import OVERLAYS, SYSTEMS, check_means_something, find_system, load_agent_config
from agent.systems.system import Spaces
from langwm_data.config_io import ConfigError, load_preset, preset_names


def test_every_name_has_a_system_and_an_overlay():
    assert {*SYSTEMS, NAME} == set(get_args(SystemName)) == set(preset_names("agent", OVERLAYS))


@pytest.mark.parametrize("name", get_args(SystemName))
@pytest.mark.parametrize("preset", ["debug", "tiny", "paper"])
def test_a_system_loads_with_every_preset(name, preset):
    assert load_agent_config(name, presets=[preset]).system == name


def test_what_makes_a_system_wins_over_presets_and_loses_to_overrides(monkeypatch):
    overlay = {"update_every": 3, "prefill_steps": 7}
    presets = {OVERLAYS: overlay, "presets": {"update_every": 2, "batch_size": 4}}
    monkeypatch.setattr(
        "agent.systems.registry.load_preset", lambda package, name, folder="presets": presets[folder]
    )
    config = load_agent_config("langwm", presets=["any"], overrides={"prefill_steps": 9})
    assert (config.batch_size, config.update_every, config.prefill_steps) == (4, 3, 9)


def test_an_unknown_system_is_refused():
    with pytest.raises(ConfigError, match="--system 'mind-reading' is unknown; allowed: langwm"):
        find_system("mind-reading")
    with pytest.raises(ConfigError, match="--system 'mind-reading' is unknown"):
        load_agent_config("mind-reading")


@pytest.mark.parametrize("given", [{"mae": "runs/mae"}, {"features": "frozen"}])
def test_an_autoencoder_for_a_system_that_reads_none_is_refused(given):
    for system in ("langwm", "mwm", NAME):
        check_means_something(system, given)
    (name,) = given
    for system in ("dreamerv2", "curl", "dreamerv2-oracle-boxes"):
        check_means_something(system, {"steps": 3, "mae": None})
        match = f"{name} '{given[name]}' means nothing to system '{system}', .* allowed for: langwm, .*mwm$"
        with pytest.raises(ConfigError, match=match):
            check_means_something(system, given)


def test_a_system_is_named_once():
    with pytest.raises(ConfigError, match="--set system=curl is not allowed; give --system curl"):
        check_means_something("dreamerv2", {"system": "curl"})


def test_spaces_are_read_from_the_environment(make_room):
    sizes = Spaces(height=16, width=16, task_dim=4, action_dim=2, task_range=(5.0,) * 4)
    assert Spaces.of(make_room()) == sizes


class NoPictures(gymnasium.Env):
    observation_space = spaces.Dict(task=spaces.Box(0, 1, (3,), np.float32))
    action_space = spaces.Box(-1, 1, (2,), np.float32)


def test_environments_that_cannot_be_learned_in_are_refused(make_room):
    with pytest.raises(ConfigError, match=r"env observes .*; allowed: a Dict with rgb"):
        Spaces.of(NoPictures())
    room = make_room()
    room.action_space = spaces.Discrete(4)
    with pytest.raises(ConfigError, match=r"env has actions Discrete\(4\); allowed: a Box with one axis"):
        Spaces.of(room)


def test_overlays_hold_only_what_a_system_is():
    assert load_preset("agent", "langwm", OVERLAYS) == {
        "finetune": {"objects": {"hides": True, "captions": "chosen"}}
    }
