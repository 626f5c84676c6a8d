"""Everything that can be configured about stage three."""

from agent.config.dreamer import (
    BehaviorConfig,
    LossScales,
    MLPConfig,
    OptimizerConfig,
    PixelConfig,
    PoolingConfig,
    RSSMConfig,
    TaskConfig,
    WorldModelConfig,
)
from agent.config.env import EnvConfig, EpisodeRandomizeConfig, RewardConfig, WheelsConfig
from agent.config.run import AgentConfig, FinetuneConfig, ReplayConfig, SystemName
from agent.config.systems import GroundingDinoConfig, KeyEncoderConfig, OracleBoxesConfig, SACConfig

__all__ = [
    "AgentConfig",
    "BehaviorConfig",
    "EnvConfig",
    "EpisodeRandomizeConfig",
    "FinetuneConfig",
    "GroundingDinoConfig",
    "KeyEncoderConfig",
    "LossScales",
    "MLPConfig",
    "OptimizerConfig",
    "OracleBoxesConfig",
    "PixelConfig",
    "PoolingConfig",
    "RSSMConfig",
    "ReplayConfig",
    "RewardConfig",
    "SACConfig",
    "SystemName",
    "TaskConfig",
    "WheelsConfig",
    "WorldModelConfig",
]
