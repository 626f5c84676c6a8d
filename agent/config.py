"""Everything that can be configured about stage three: environment, replay, world model, behaviour."""

import math
from dataclasses import field
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from langwm_data.config import (
    CameraConfig,
    LabelsConfig,
    LightLimits,
    RenderConfig,
    RobotConfig,
    ScenesConfig,
)
from langwm_data.config_io import ConfigError, config
from pretrain.config import AugmentConfig, MAEConfig, ObjectMaskConfig, OptimConfig, TextConfig

Positive = Annotated[float, Field(gt=0)]
PositiveInt = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]


def _ascending(edges: tuple[float, ...]) -> tuple[float, ...]:
    if len(edges) < 2 or edges[0] <= 0 or any(a >= b for a, b in pairwise(edges)):
        raise ValueError("give at least two positive distances in ascending order")
    return edges


@config
class RewardConfig:
    """Terms of the reward. Source: iGibson turtlebot_point_nav.yaml."""

    progress: float = 1.0
    """Per metre by which the geodesic distance to the goal shrinks."""
    collision: float = -0.1
    """Once for every step in contact with an obstacle."""
    success: float = 10.0
    """On arriving at the goal."""


@config
class EpisodeRandomizeConfig(LightLimits):
    """What is drawn anew for every episode beside its materials. Source: ours (ADR-0013)."""

    lights: Literal["fixed", "episode"] = "fixed"
    """``fixed``: as ``render.lights`` says; ``episode``: drawn around it from the seed of the textures."""


@config
class WheelsConfig:
    """The two driven wheels, read where ``action`` is ``wheel``.

    Source: iGibson 1.0 (velocity of a joint without limits); ROS TurtleBot description, approximately.
    """

    max_rad_s: Positive = 15.0
    """Turning speed of a wheel at an entry of 1."""
    radius_m: Positive = 0.035
    """With ``max_rad_s``: 5.25 cm per step at most."""
    axle_m: Positive = 0.23
    """Between the wheels: 4.6 rad/s on the spot at most."""


@config
class EnvConfig:
    """PointGoal navigation, or any environment of Gymnasium's.

    Source: iGibson turtlebot_point_nav.yaml unless said otherwise.
    """

    id: str | None = None
    """Another environment, named as ``gymnasium.make`` names it (``module:Name`` imports the module first).
    Of the fields below it reads ``kwargs``, ``pixels`` and the camera's size alone. None: PointGoal
    navigation."""
    kwargs: dict[str, Any] = field(default_factory=dict, hash=False)
    """What ``gymnasium.make`` is given beside ``id``."""
    pixels: bool = False
    """Frames of ``id`` are what it renders; they take the place of an observation that is one vector."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    scenes: ScenesConfig = field(default_factory=ScenesConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    randomize: EpisodeRandomizeConfig = field(default_factory=EpisodeRandomizeConfig)
    labels: LabelsConfig = field(default_factory=LabelsConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)
    protocol: Literal["igibson", "habitat"] = "igibson"
    """``igibson``: arriving within ``success_radius_m`` is noticed and ends the episode; ``habitat``: the
    agent ends it by a stop action, one more entry, and succeeds within ``stop_radius_m`` of the goal."""
    action: Literal["velocity", "wheel", "kinematic"] = "velocity"
    """What the first two entries of an action mean: speeds forwards and of turning; of the left and the right
    wheel; metres forwards and radians to the left. Source: method notes, decision 23."""
    contacts: Literal["physics", "map"] = "physics"
    """``physics``: solids as they stand, by PyBullet; ``map``: their outlines seen from above, for which
    PyBullet need not be installed. The robot slides along both. Source: ours (ADR-0018)."""
    with_start_pose: bool = False
    """Add x, y in metres and yaw in radians to the task observation, in the frame of the start.
    Source: method notes, decision 22."""
    max_linear_m_s: Positive = 0.5
    """``velocity``: speed of action (1, 0), 5 cm per step; (-1, 0) drives backwards. Source: method notes,
    decision 23."""
    max_angular_rad_s: Positive = math.pi / 2
    """``velocity``: turning speed of action (0, 1), 9 degrees to the left per step. Source: method notes,
    decision 23."""
    max_forward_m: Positive = 0.05
    """``kinematic``: metres driven by action (1, 0); as far as ``velocity`` in a step. Source: ours."""
    max_turn_rad: Annotated[float, Field(gt=0, le=math.pi)] = math.pi / 20
    """``kinematic``: radians turned by action (0, 1), before driving; as many as ``velocity``.
    Source: ours."""
    wheels: WheelsConfig = field(default_factory=WheelsConfig)
    step_s: Positive = 0.1
    """Simulated time of one step."""
    physics_hz: PositiveInt = 240
    max_steps: PositiveInt = 500
    """The episode is truncated here."""
    success_radius_m: Positive = 0.36
    """``igibson``: straight distance in the plane below which the goal counts as reached."""
    stop_radius_m: Positive = 0.2
    """``habitat``: length of the shortest way to the goal below which stopping is a success.
    Source: habitat-lab."""
    stop_above: Annotated[float, Field(gt=-1, lt=1)] = 0.5
    """``habitat``: the last entry of an action stops above this. At 0.5 a uniform one stops one time in four,
    as a random choice of Habitat's four actions does. Source: ours (ADR-0018)."""
    distance_edges_m: Annotated[tuple[float, ...], AfterValidator(_ascending)] = (1.0, 3.0, 6.0, 10.0)
    """Edges of the tiers of geodesic distance from start to goal; the first and last bound all of them."""
    drawn_tiers: PositiveInt | None = None
    """Episodes that are drawn, not given, lie in the nearest so many tiers; in all of them when None. So an
    agent can be scored on goals farther away than those it learned on."""
    with_labels: bool = False
    """Add ``info["objects"]`` and ``info["instance"]``: what online finetuning of the MAE needs."""
    is_blind: bool = False
    """Black frames in place of rendering: many times faster, for policies that read the task entry alone."""
    seed_eval: int = 0
    """Seed of the fixed evaluation episodes."""

    def __post_init__(self) -> None:
        """Refuse lights that the renderer lacks, tiers that there are not, and words without an env."""
        if self.id is None and (self.kwargs or self.pixels):
            raise ConfigError("env.kwargs and env.pixels are of another environment; give env.id as well")
        if self.randomize.lights != "fixed" and self.render.backend == "tiny":
            raise ConfigError(
                f"env.randomize.lights {self.randomize.lights} needs env.render.backend auto, gl or embree"
            )
        num_tiers = len(self.distance_edges_m) - 1
        if self.drawn_tiers is not None and self.drawn_tiers > num_tiers:
            raise ConfigError(
                f"env.drawn_tiers {self.drawn_tiers} is not allowed:"
                f" env.distance_edges_m has {num_tiers} tiers"
            )


@config
class ReplayConfig:
    """Buffer of whole episodes on disk."""

    capacity_steps: PositiveInt = 300_000
    """The oldest episodes leave when the buffer holds more steps than this. Source: Sec. 3.2."""
    prioritize_ends: bool = True
    """Draw chunks that contain an episode's end more often. Source: MWM configs.yaml (rlbench)."""


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


Augmentation = Literal["crop", "pad_crop", "translate", "grayscale", "cutout", "color_jitter"]
_PLACES = ("crop", "pad_crop", "translate")


@config
class SACConfig:
    """Soft actor-critic on pixels, as CURL and RAD share it. Source: the public code of both."""

    is_contrastive: bool = False
    """Whether two augmented views of a stack of frames must find each other: CURL."""
    data_augs: tuple[Augmentation, ...] = ("crop",)
    """What is done to frames while learning, in this order. Frames are never flipped or turned: bearing and
    turning speed would have to be mirrored."""
    crop_share: Annotated[float, Field(gt=0, le=1)] = 0.84
    """Edges of a ``crop`` as a share of the frame's, rounded up to a multiple of 4 px. Source: 100 to 84."""
    translate_share: Annotated[float, Field(ge=1)] = 1.08
    """Edges of the black canvas of ``translate``, likewise. Source: 100 to 108."""
    padding_px: PositiveInt = 10
    """``pad_crop``: pad every side by this much and crop back. Source: Table 2, spatial jitter."""
    grayscale_probability: Fraction = 0.3
    frame_stack: PositiveInt = 3
    """Frames of one observation."""
    filters: PositiveInt = 32
    """Of each of the four convolutions."""
    feature_dim: PositiveInt = 50
    """Width of the encoder's output, to which the task observation is appended."""
    hidden: PositiveInt = 1024
    """Width of the two hidden layers of actor and critics."""
    batch_size: PositiveInt = 128
    """Transitions per update. Source: the commands in CURL's README."""
    discount: Fraction = 0.99
    learning_rate: Positive = 1e-3
    """Of actor, critics and encoder."""
    alpha: Positive = 0.1
    """Weight of the entropy at the beginning; learned so that the entropy is minus the number of actions."""
    alpha_learning_rate: Positive = 1e-4
    critic_tau: Fraction = 0.01
    """Share of the critics that enters the target critics each time."""
    encoder_tau: Fraction = 0.05
    """The same of the encoder; the target encoder is also CURL's key encoder."""
    target_every: PositiveInt = 2
    """Updates between two moves of the targets."""
    actor_every: PositiveInt = 2
    """Updates between two updates of the actor."""

    def __post_init__(self) -> None:
        """Refuse augmentations that exclude each other and contrast without any."""
        if sum(name in _PLACES for name in self.data_augs) > 1:
            raise ConfigError(
                f"sac.data_augs {', '.join(self.data_augs)}: give one of {', '.join(_PLACES)}, not several"
            )
        if self.is_contrastive and not self.data_augs:
            raise ConfigError(
                "sac.is_contrastive needs views that differ; give sac.data_augs, such as [crop]"
            )


@config
class GroundingDinoConfig:
    """The frozen detector of dreamerv2-grounding-dino. Source: ours (method notes, section 5)."""

    model: Annotated[str, Field(min_length=1)] = "IDEA-Research/grounding-dino-tiny"
    """A Grounding DINO on the Hugging Face hub, or a local folder of one."""
    short_side_px: Annotated[int, Field(ge=32)] = 800
    """Frames are enlarged so that their shorter side has this length. Source: Grounding DINO."""
    num_objects: PositiveInt = 32
    """So many of the surest detections are pooled."""


@config
class OracleBoxesConfig:
    """What dreamerv2-oracle-boxes is told of a frame. Source: ours (method notes, section 5)."""

    num_objects: PositiveInt = 8
    """The nearest ones in sight."""


@config
class KeyEncoderConfig:
    """A slowly moving copy of a MAE that is finetuned. Source: Table 3; method notes, section 1."""

    mode: Literal["none", "ema_features", "infonce"] = "none"
    """``ema_features``: the memory is given the copy's features, in acting too; ``infonce``: the copy sees a
    second, augmented view of each frame, and the state must find it among those of the batch."""
    momentum: Annotated[float, Field(gt=0, lt=1)] = 0.999
    """Weight of the past in the copy's running mean of the MAE's weights."""


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
    """Memory for the tokens of frames seen before, where features are frozen."""
    device: str = "cpu"
    precision: Literal["fp32", "bf16"] = "fp32"
    """``bf16``: autocast; weights and optimizers stay in fp32."""
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
