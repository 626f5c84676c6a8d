"""A LanGWM for the empty room, untrained."""

import dataclasses

import pytest

from agent.systems import langwm
from agent.systems.system import Spaces


@pytest.fixture(scope="session")
def spaces():
    return Spaces(height=16, width=16, task_dim=4, action_dim=2)


@pytest.fixture
def frozen_config(tiny_config, tiny_mae, tmp_path):
    """Features of a MAE that was pretrained, so to say."""
    tiny_mae.save_pretrained(tmp_path / "mae" / "model")
    return dataclasses.replace(tiny_config, features="frozen", mae=str(tmp_path / "mae"))


@pytest.fixture
def model(frozen_config, spaces):
    return langwm.create(frozen_config, spaces).eval()
