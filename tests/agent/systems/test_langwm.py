import dataclasses
import math
from pathlib import Path

import pytest
import torch

from agent.config import AgentConfig
from agent.systems import langwm
from langwm_data.config_io import ConfigError
from pretrain import parts
from pretrain.config import MAEConfig
from pretrain.mae import LanguageGroundedMAE


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


def test_frames_are_encoded_a_few_at_a_time(tiny_config, spaces, monkeypatch):
    perception = langwm.create(tiny_config, spaces).perception
    rgb = torch.randint(0, 256, (7, 16, 16, 3), dtype=torch.uint8)
    together = perception.encode({"rgb": rgb})
    monkeypatch.setattr(parts, "ROWS_AT_ONCE", 3)
    torch.testing.assert_close(perception.encode({"rgb": rgb}), together)
    torch.testing.assert_close(perception.mae.encode(rgb), together)


@pytest.mark.parametrize(
    ("changes", "repeats"), [({}, 0), ({"features": "finetuned"}, 2), ({"steps": 10**7}, 2)]
)
def test_frames_are_encoded_again_only_where_the_mae_learns_or_not_all_fit(
    changes, repeats, frozen_config, spaces, monkeypatch
):
    tight = dataclasses.replace(frozen_config, token_cache_mib=1)
    perception = langwm.create(dataclasses.replace(tight, **changes), spaces).perception
    rgb = torch.randint(0, 256, (2, 16, 16, 3), dtype=torch.uint8)
    first, calls, encode = perception.encode({"rgb": rgb}), [], LanguageGroundedMAE.features
    monkeypatch.setattr(
        LanguageGroundedMAE, "features", lambda mae, frames: calls.append(len(frames)) or encode(mae, frames)
    )
    assert torch.equal(perception.encode({"rgb": rgb}), first)
    assert sum(calls) == repeats


def test_only_finetuning_needs_labels(tiny_config, frozen_config):
    assert langwm.SYSTEM.needs_labels(tiny_config)
    assert not langwm.SYSTEM.needs_labels(frozen_config)


def test_frames_of_another_camera_than_the_mae_learned_through_are_refused(frozen_config, spaces, tiny_mae):
    focal_px = 8 / math.tan(math.radians(frozen_config.env.camera.vertical_fov_deg / 2))
    for scale in (1.0, 2.0):
        f = scale * focal_px
        tiny_mae.intrinsics = ((f, 0.0, 8.0), (0.0, f, 8.0), (0.0, 0.0, 1.0))
        tiny_mae.save_pretrained(Path(frozen_config.mae) / "model")
        if scale == 1.0:
            langwm.create(frozen_config, spaces)
    with pytest.raises(ConfigError, match=r"vertical_fov_deg is \d+ but the MAE learned through a camera of"):
        langwm.create(frozen_config, spaces)
