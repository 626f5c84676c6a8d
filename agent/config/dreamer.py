"""World model and behaviour: sizes, losses and how they are trained."""

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field

from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Fraction, NonNegative, Positive, PositiveInt


@config
class PoolingConfig:
    """Pooling transformer autoencoder over visual and task tokens. Source: Table 3."""

    dim: PositiveInt = 256
    num_heads: PositiveInt = 4
    mlp_ratio: PositiveInt = 4
    num_layers: PositiveInt = 2
    """Of the encoder and of the decoder."""
    norm_eps: Positive = 1e-6
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.1

    def __post_init__(self) -> None:
        """Refuse heads that do not divide the width."""
        if self.dim % self.num_heads:
            raise ConfigError(
                f"world_model.pooling.dim {self.dim} must be a multiple of num_heads {self.num_heads}"
            )


@config
class RSSMConfig:
    """Sizes of the recurrent state-space model. Source: Table 3."""

    num_latents: PositiveInt = 32
    num_classes: PositiveInt = 32
    deter: PositiveInt = 1024
    """Width of the recurrent state."""
    hidden: PositiveInt = 1024
    """Width of the layers around it."""
    unimix: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Share of the uniform distribution in the latents'. Source: DreamerV3 (0.01), off."""

    @property
    def feat_dim(self) -> int:
        """Width of the state as heads, actor and critic read it."""
        return self.num_latents * self.num_classes + self.deter


@config
class MLPConfig:
    """A perceptron with ELU. Source: Table 3."""

    layers: PositiveInt = 4
    units: PositiveInt = 400


@config
class PixelConfig:
    """Convolutions over frames, where a system learns from pixels. Source: DreamerV2."""

    channels: PositiveInt = 48
    """Of the first convolution; each of the three that follow has twice as many as the one before."""
    is_augmented: bool = False
    """Whether the encoder sees frames changed as ``finetune.augment`` says, each sequence by a draw of its
    own; the decoder tells the unchanged ones again. Source: method notes, decision 30."""


@config
class TaskConfig:
    """Encoder of the task observation and its mirror. Source: Sec. 4.1; method notes, decision 21."""

    layers: PositiveInt = 4
    units: PositiveInt = 256
    scale: tuple[Positive, ...] | None = None
    """Divides the entries of the task observation. None: the greatest magnitude that the environment's space
    allows each, and 5 where it sets no bounds; for PointGoal 5 m, pi rad and the robot's speeds.
    Source: ours."""
    skips_pooling: bool = False
    """Hand the task token to the memory also beside the average, of which it is one part in 82.
    Source: ours (ADR-0009)."""


@config
class LossScales:
    """Weights of the world model's loss terms; the keys are the terms. A system has those of its own
    observation model beside task, reward, discount and KL.
    """

    token: NonNegative = 1.0
    """Image tokens from the state. Source: Eq. 5; method notes, decision 17."""
    pool: NonNegative = 1.0
    """Image tokens from the embedding. Source: Table 3 (decoder input); decision 16."""
    image: NonNegative = 1.0
    """Pixels from the state, summed over the frame. Source: DreamerV2."""
    vector: NonNegative = 1.0
    """Vector that describes the frame from the state, summed over its entries. Source: DreamerV2."""
    task: NonNegative = 100.0
    """Task observation from the state. At 1 the KL term would pay more for these four numbers than
    their reconstruction returns; 100 keeps them to a tenth of their scale. Source: ours."""
    reward: NonNegative = 1.0
    discount: NonNegative = 1.0
    contrast: NonNegative = 1.0
    """The frame's second view found from the state, where ``key_encoder.mode`` is ``infonce``."""
    kl: NonNegative = 1.0
    """Source: Table 3 (beta)."""


@config
class WorldModelConfig:
    """World model: pooling, memory, heads and how they are trained."""

    pooling: PoolingConfig = field(default_factory=PoolingConfig)
    pixels: PixelConfig = field(default_factory=PixelConfig)
    """Read by the systems dreamerv2 and dreamerv2-da."""
    vector: MLPConfig = field(default_factory=MLPConfig)
    """Encoder and decoder of dreamerv2-grounding-dino and dreamerv2-oracle-boxes. Source: DreamerV2."""
    rssm: RSSMConfig = field(default_factory=RSSMConfig)
    head: MLPConfig = field(default_factory=MLPConfig)
    """Reward and discount heads."""
    task: TaskConfig = field(default_factory=TaskConfig)
    loss_scales: LossScales = field(default_factory=LossScales)
    kl_balance: Fraction = 0.8
    """Share of the KL gradient that moves the prior. Source: DreamerV2."""
    free_nats: NonNegative = 0.01
    """KL below this is left alone, per step. Source: MWM; decision 18."""
    reward_transform: Literal["symlog", "identity", "twohot"] = "symlog"
    """Space in which the reward is predicted. Source: MWM; ``identity`` is DreamerV2's, ``twohot``, a
    distribution over bins, DreamerV3's."""
    discount: Fraction = 0.99
    """Gamma: what the discount head predicts for a state that is not terminal. Source: DreamerV2."""
    learning_rate: Positive = 3e-4
    """Source: Table 3."""


@config
class BehaviorConfig:
    """Actor and critic, trained in imagination. Source: Table 3 unless said otherwise."""

    imag_horizon: PositiveInt = 15
    actor: MLPConfig = field(default_factory=MLPConfig)
    critic: MLPConfig = field(default_factory=MLPConfig)
    """Unlisted in the paper; as the actor (decision 25)."""
    value_transform: Literal["identity", "twohot"] = "identity"
    """How the critic predicts the return. ``twohot``: as a distribution over bins. Source: DreamerV2; V3."""
    return_scale: Literal["none", "percentile"] = "none"
    """``percentile``: the actor's returns are divided by a running mean of the distance between their 5th and
    95th percentile, where that is above 1. Source: DreamerV2; V3."""
    lambda_: Fraction = 0.95
    """Source: DreamerV2."""
    entropy_scale: NonNegative = 1e-4
    """Source: MWM configs.yaml."""
    actor_learning_rate: Positive = 1e-4
    critic_learning_rate: Positive = 1e-4
    slow_critic_every: PositiveInt = 100
    """Updates between hard copies of the critic into the slow critic."""


@config
class OptimizerConfig:
    """Adam for world model, actor and critic. Source: Table 3."""

    eps: Positive = 1e-5
    grad_clip: Positive = 100.0
    """Largest norm of the gradient."""
