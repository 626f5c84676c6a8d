import pytest

from agent.config import RewardConfig
from agent.envs.rewards import navigation_reward


def test_reward_by_hand():
    config = RewardConfig()
    assert navigation_reward(config, progress_m=0.05, is_collision=False, is_success=False) == 0.05
    assert navigation_reward(config, progress_m=-0.05, is_collision=True, is_success=False) == pytest.approx(
        -0.15
    )
    assert navigation_reward(config, progress_m=0.04, is_collision=True, is_success=True) == pytest.approx(
        9.94
    )


def test_weights_come_from_the_config():
    config = RewardConfig(progress=2.0, collision=-1.0, success=5.0)
    reward = navigation_reward(config, progress_m=0.5, is_collision=True, is_success=True)
    assert reward == pytest.approx(1.0 - 1.0 + 5.0)
