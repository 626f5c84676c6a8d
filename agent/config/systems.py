"""What single systems have of their own."""

from typing import Annotated, Literal

from pydantic import Field

from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Fraction, Positive, PositiveInt

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
