import dataclasses

import pytest

from agent.config import AgentConfig
from agent.systems import langwm
from langwm_data.config_io import ConfigError
from pretrain.config import MAEConfig


def test_sizes_of_the_paper(model, spaces):
    """81 visual tokens and one task token; the state is 32 x 32 + 1024 wide."""
    config = AgentConfig()
    assert 1 + MAEConfig().num_patches + 1 == 82
    assert config.world_model.rssm.feat_dim == 32 * 32 + 1024
    paper = langwm._assemble(model.perception, config, spaces)
    assert paper.world_model.rssm.feat_dim == 2048
    assert paper.behavior.actor[0].out_features == 400
    assert config.env.max_steps == 500


def test_frames_that_do_not_fit_the_mae_are_refused(frozen_config, spaces):
    with pytest.raises(ConfigError, match=r"32 x 16 pixels but the MAE reads 16 x 16"):
        langwm.create(frozen_config, dataclasses.replace(spaces, height=32))


def test_only_finetuning_needs_labels(tiny_config, frozen_config):
    assert langwm.SYSTEM.needs_labels(tiny_config)
    assert not langwm.SYSTEM.needs_labels(frozen_config)
