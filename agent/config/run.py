"""One training run: replay, finetuning of the autoencoder, schedule, and all the rest by reference."""

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field

from agent.config.dreamer import BehaviorConfig, OptimizerConfig, WorldModelConfig
from agent.config.env import EnvConfig
from agent.config.systems import GroundingDinoConfig, KeyEncoderConfig, OracleBoxesConfig, SACConfig
from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Count, PositiveInt
from pretrain.config import AugmentConfig, MAEConfig, ObjectMaskConfig, OptimConfig, Precision, TextConfig


@config
class ReplayConfig:
    """Buffer of whole episodes on disk."""

    capacity_steps: PositiveInt = 300_000
    """The oldest episodes leave when the buffer holds more steps than this. Source: Sec. 3.2."""
    prioritize_ends: bool = True
    """Draw chunks that contain an episode's end more often. Source: MWM configs.yaml (rlbench)."""


@config
class FinetuneConfig:
    """How the MAE goes on learning from replay, and what it is where none was pretrained."""

    model: MAEConfig = field(default_factory=MAEConfig)
    """Used where no pretrained MAE is given."""
    text: TextConfig = field(default_factory=TextConfig)
    """Used where no pretrained MAE is given."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    objects: ObjectMaskConfig = field(default_factory=ObjectMaskConfig)
    optimizer: OptimConfig = field(default_factory=OptimConfig)
    batch_frames: PositiveInt = 800
    """Source: Table 2 (16 x 50)."""
    pretrain_updates: Count = 5000
    """Updates of the MAE on the prefilled replay, before anything else learns. Source: MWM."""

    def __post_init__(self) -> None:
        """Refuse a schedule that would need to know when learning ends."""
        if self.optimizer.schedule != "constant":
            raise ConfigError(
                f"finetune.optimizer.schedule {self.optimizer.schedule!r} must be 'constant':"
                " learning from replay has no last step"
            )


SystemName = Literal[
    "langwm",
    "dreamerv2",
    "dreamerv2-da",
    "dreamerv2-grounding-dino",
    "dreamerv2-oracle-boxes",
    "curl",
    "rad",
    "langwm-empty-language",
    "langwm-no-mask-empty-language",
    "langwm-no-mask",
    "mwm",
    "own-encoder",
]
"""Everything that ``train-agent --system`` knows; ``agent.systems.registry`` holds what each name means."""


@config
class AgentConfig:
    """One training run of an agent."""

    system: SystemName = "langwm"
    """What learns; each has an overlay in ``presets/systems`` that makes it what it is."""
    steps: PositiveInt = 100_000
    """Environment steps, the prefill included. Source: Sec. 4.1; method notes, decision 24."""
    seed: int = 0
    mae: str | None = None
    """Folder of a pretrain-mae run; without one the MAE learns from replay alone."""
    features: Literal["frozen", "finetuned"] = "finetuned"
    """Whether the MAE goes on learning. Source: method notes, decision 26."""
    token_cache_mib: PositiveInt = 1024
    """Memory for the tokens of frames seen before, where features are frozen and computed on the CPU. A MAE's
    are remembered only where those of all ``steps`` fit."""
    device: str = "cpu"
    precision: Precision = "fp32"
    """``bf16``: autocast; weights and optimizers stay in fp32. ``auto``: bf16 where the device has
    instructions for it."""
    env: EnvConfig = field(default_factory=EnvConfig)
    replay: ReplayConfig = field(default_factory=ReplayConfig)
    finetune: FinetuneConfig = field(default_factory=FinetuneConfig)
    key_encoder: KeyEncoderConfig = field(default_factory=KeyEncoderConfig)
    world_model: WorldModelConfig = field(default_factory=WorldModelConfig)
    behavior: BehaviorConfig = field(default_factory=BehaviorConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    grounding_dino: GroundingDinoConfig = field(default_factory=GroundingDinoConfig)
    oracle_boxes: OracleBoxesConfig = field(default_factory=OracleBoxesConfig)
    sac: SACConfig = field(default_factory=SACConfig)
    """Read by the systems curl and rad."""
    batch_size: PositiveInt = 16
    """Sequences per update. Source: Table 2."""
    batch_length: Annotated[int, Field(ge=2)] = 50
    """Steps per sequence. Source: Table 2."""
    prefill_steps: PositiveInt = 5000
    """Steps with random actions before the first update. Source: MWM configs.yaml."""
    update_every: PositiveInt = 5
    """Environment steps per update. Source: Sec. 4.1; method notes, decision 1."""
    log_every: PositiveInt = 50
    """Updates per line of metrics."""
    checkpoint_every: PositiveInt = 5000
    """Environment steps."""
    eval_episodes: PositiveInt = 500
    """On each floor. Source: method notes, section 6."""

    @property
    def num_updates(self) -> int:
        """Ordinary updates that the run will take."""
        return max(0, self.steps - self.prefill_steps) // self.update_every
