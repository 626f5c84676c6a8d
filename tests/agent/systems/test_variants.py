"""The paper's ablations, the cell that it leaves out, and MWM: what each of them learns from."""

import dataclasses
import logging

import pytest
import torch

from agent.systems import langwm
from agent.systems.pretrained import load_mae
from agent.systems.registry import SYSTEMS, load_agent_config
from agent.train import train_agent
from langwm_data.config_io import ConfigError, config_to_yaml
from pretrain.config import ObjectMaskConfig, PretrainConfig
from pretrain.metrics import read_metrics

VARIANTS = {
    "langwm": (True, "chosen", "depth"),
    "langwm-empty-language": (True, "none", "depth"),
    "langwm-no-mask-empty-language": (False, "none", "depth"),
    "langwm-no-mask": (False, "chosen", "depth"),
    "mwm": (False, "none", "rgb"),
}


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize("preset", ["tiny", "paper"])
def test_a_variant_is_one_cell_whatever_the_preset(name, preset):
    finetune = load_agent_config(name, presets=[preset]).finetune
    assert (finetune.objects.hides, finetune.objects.captions, finetune.model.target) == VARIANTS[name]


@pytest.mark.parametrize("name", VARIANTS)
def test_objects_are_labelled_only_where_something_is_hidden_or_told(name):
    config = load_agent_config(name, overrides={"features": "finetuned"})
    assert SYSTEMS[name].needs_labels(config) == (VARIANTS[name][:2] != (False, "none"))
    assert not SYSTEMS[name].needs_labels(dataclasses.replace(config, features="frozen"))


def test_tables_are_told_what_a_variant_is():
    notes = {name: SYSTEMS[name].note for name in VARIANTS}
    assert len(set(notes.values())) == len(VARIANTS)
    assert "not in the paper" in notes["langwm-no-mask"]
    assert "colours" in notes["mwm"]


def variant_of(config, name):
    overlay = load_agent_config(name)
    model = dataclasses.replace(config.finetune.model, target=overlay.finetune.model.target)
    finetune = dataclasses.replace(config.finetune, model=model, objects=overlay.finetune.objects)
    world_model = dataclasses.replace(config.world_model, loss_scales=overlay.world_model.loss_scales)
    return dataclasses.replace(config, system=name, finetune=finetune, world_model=world_model)


@pytest.mark.parametrize("name", ["langwm-no-mask", "mwm"])
def test_a_variant_learns_what_it_says(name, tiny_config, make_room, tmp_path):
    run = train_agent(variant_of(tiny_config, name), tmp_path / "run", env=make_room(max_steps=9))
    keys = {key for row in read_metrics(run) for key in row}
    assert ("mae/rgb_loss" in keys, "mae/depth_loss" in keys) == (name == "mwm", name != "mwm")
    assert ("wm/pool_loss" in keys) == (name != "mwm")
    masks = [row["mae/mask_fraction"] for row in read_metrics(run) if "mae/mask_fraction" in row]
    assert masks
    assert max(masks) == 0


@pytest.fixture
def save_mae(tiny_mae, tmp_path):
    """A run of pretraining with these objects."""

    def save(objects=None, name="mae"):
        tiny_mae.save_pretrained(tmp_path / name / "model")
        if objects is not None:
            config = PretrainConfig(objects=objects, mae=tiny_mae.config, text=tiny_mae.text)
            (tmp_path / name / "config.yaml").write_text(config_to_yaml(config))
        return str(tmp_path / name)

    return save


@pytest.mark.parametrize("folder", ["", "/model"])
def test_a_mae_is_taken_by_the_system_that_it_was_pretrained_for(folder, save_mae, caplog):
    path = save_mae(ObjectMaskConfig(hides=True, captions="none")) + folder
    finetune = load_agent_config("langwm-empty-language").finetune
    with caplog.at_level(logging.WARNING):
        assert load_mae(path, "langwm-empty-language", finetune).config.target == "depth"
    assert caplog.text == ""


@pytest.mark.parametrize("folder", ["", "/model"])
@pytest.mark.parametrize(
    ("system", "message"),
    [
        ("langwm", r"objects\.captions is 'none' there and finetune\.objects\.captions is 'chosen'"),
        ("langwm-no-mask-empty-language", r"objects\.hides is True there and .* is False"),
        ("mwm", r"model\.target is 'depth' there and .* is 'rgb'; objects\.hides is True there"),
    ],
)
def test_a_mae_that_was_pretrained_otherwise_is_refused(
    folder, system, message, save_mae, tiny_config, spaces
):
    mae = save_mae(ObjectMaskConfig(hides=True, captions="none")) + folder
    config = dataclasses.replace(variant_of(tiny_config, system), mae=mae)
    with pytest.raises(ConfigError, match=f"was not pretrained as system '{system}' says: .*{message}"):
        langwm.create(config, spaces)


def test_a_mae_that_does_not_say_how_it_was_pretrained_is_taken_with_a_warning(save_mae, caplog):
    with caplog.at_level(logging.WARNING):
        mae = load_mae(save_mae(), "langwm-no-mask", load_agent_config("langwm-no-mask").finetune)
    assert isinstance(mae.cls_token, torch.Tensor)
    assert "does not say which objects it hid and told of; taken as langwm-no-mask" in caplog.text
