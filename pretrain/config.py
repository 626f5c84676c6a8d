"""Everything that can be configured about stage two, in the order of the paper's Table 2.

The defaults are the paper's values; where it is silent or its word is known to hurt, the method notes'
decisions. Presets change them in the open.
"""

import math
from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field

from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Count, Fraction, Positive, PositiveInt

Precision = Literal["fp32", "bf16", "auto"]
"""Of products of matrices; see ``pretrain.precision``."""


@config
class AugmentConfig:
    """Changes to the frame before objects are hidden. Probabilities: BYOL's, the paper gives none."""

    padding_px: Count = 10
    """Spatial jitter: pad by this much on every side, crop back at random."""
    hue: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    """Largest shift, as a share of the colour circle."""
    brightness: Fraction = 0.4
    """Largest relative change."""
    contrast: Fraction = 0.4
    saturation: Fraction = 0.2
    color_probability: Fraction = 0.8
    grayscale_probability: Fraction = 0.2
    blur_probability: Fraction = 0.5
    blur_sigma_px: tuple[Positive, Positive] = (0.1, 2.0)
    """Least and largest standard deviation of the Gaussian."""

    def __post_init__(self) -> None:
        """Refuse a range that runs backwards."""
        low, high = self.blur_sigma_px
        if low > high:
            raise ConfigError(f"augment.blur_sigma_px {low} to {high} is not a range")


@config
class ObjectMaskConfig:
    """Which objects are hidden behind boxes, and what is said about them. Source: Sec. 3.1.1."""

    max_objects: PositiveInt = 3
    hides: bool = True
    """Whether the chosen objects are hidden. Without, the autoencoder has dropped tokens alone to fill in.
    Source: the paper's ablation of object masks."""
    captions: Literal["chosen", "scene", "none"] = "chosen"
    """What sentences are about. ``chosen``: the objects that are hidden, or would be; ``scene``: the largest
    in the frame, whatever is hidden; ``none``: nothing. Source: the paper's ablation of language; for
    ``scene``, Voltron, which describes the whole scene and hides tokens at random."""
    margin_px: Count = 10
    """Each side of a box moves outwards by 0 to this many pixels."""
    max_area: Fraction = 0.75
    """No further object once this share of the image is hidden."""
    distance_format: Literal["integer", "decimal"] = "integer"
    """How captions say metres."""
    caption_dropout: Fraction = 0.0
    """How often hidden objects go unmentioned. Source: ours (method notes, decision 9)."""
    box_dropout: Fraction = 0.0
    """How often nothing is hidden or said, as at test time. Source: ours (decision 9)."""


@config
class TextConfig:
    """The frozen text encoder."""

    model: Annotated[str, Field(min_length=1)] = "bert-base-uncased"
    """``minilm`` (embedded), a BERT on the Hugging Face hub, or a local folder of one."""
    num_tokens: Annotated[int, Field(ge=2, le=512)] = 20
    """Captions are padded or cut to this many; one pooled token follows."""
    num_sentences: Annotated[int, Field(ge=1, le=16)] = 1
    """1: all sentences share ``num_tokens``, as in the paper; more: each sentence has so many tokens of its
    own, so that none is cut short, and those past the last place are left out. Source: ours (decision 10)."""
    precision: Precision = "fp32"
    cache_mib: PositiveInt = 512
    """Memory for the embeddings of captions seen before; the least recently used go first."""

    @property
    def num_language_tokens(self) -> int:
        """Of one caption, with the pooled token of each part."""
        return self.num_sentences * (self.num_tokens + 1)


@config
class MAEConfig:
    """The masked autoencoder. Source: Table 2, "(Object) Masked Autoencoder"."""

    height: PositiveInt = 128
    """Pixels."""
    width: PositiveInt = 160
    """Pixels."""
    conv_channels: Annotated[tuple[PositiveInt, ...], Field(min_length=1)] = (32, 64, 128, 256)
    """One early convolution (kernel 4, stride 2, ELU) each."""
    dim: Annotated[int, Field(ge=4)] = 256
    mask_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.75
    """Share of visual tokens dropped in training."""
    num_heads: PositiveInt = 4
    mlp_ratio: PositiveInt = 4
    encoder_layers: PositiveInt = 4
    decoder_layers: PositiveInt = 3
    layer_norm_eps: Positive = 1e-6
    """The table's "1^-6" read as 1e-6."""
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.1
    target: Literal["depth", "rgb"] = "depth"
    """What is filled in. ``rgb``: colours, as MWM does. Source: Sec. 3.1.1 (decision 4)."""
    max_depth_m: Positive = 10.0
    """Depth is clipped here and predicted in units of it. Source: ours (decision 5)."""
    reward_loss: Literal["symlog", "mse"] = "symlog"
    """``mse`` is the paper's word and its preset's; ``symlog`` is MWM's code (decisions 15 and 35)."""

    def __post_init__(self) -> None:
        """Refuse sizes that do not fit together."""
        stride = self.patch_px
        for name, value in (("height", self.height), ("width", self.width)):
            if value % stride:
                raise ConfigError(
                    f"mae.{name} {value} must be a multiple of {stride}: "
                    f"{len(self.conv_channels)} convolutions each halve the image"
                )
        if self.dim % self.num_heads or self.dim % 4:
            raise ConfigError(f"mae.dim {self.dim} must be a multiple of 4 and of num_heads {self.num_heads}")
        if self.num_kept < 1:
            raise ConfigError(
                f"mae.mask_ratio {self.mask_ratio} leaves none of the {self.num_patches} visual tokens"
            )

    @property
    def patch_px(self) -> int:
        """Edge of the image patch that one visual token predicts."""
        return 2 ** len(self.conv_channels)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of visual tokens."""
        return self.height // self.patch_px, self.width // self.patch_px

    @property
    def num_patches(self) -> int:
        """Visual tokens of one image."""
        return self.grid[0] * self.grid[1]

    @property
    def num_channels(self) -> int:
        """Of the target."""
        return 1 if self.target == "depth" else 3

    @property
    def num_kept(self) -> int:
        """Visual tokens that the encoder sees in training."""
        return math.floor(self.num_patches * (1 - self.mask_ratio) + 1e-6)  # 80 * (1 - 0.9) is 7.99...


@config
class OptimConfig:
    """One gradient step of Adam. Source: Tables 2 and 3."""

    learning_rate: Positive = 1e-4
    epsilon: Positive = 1e-5
    max_grad_norm: Positive = 100.0
    warmup_steps: Count = 2500
    """Linear. Source: MWM configs.yaml; the paper does not say."""
    schedule: Literal["constant", "cosine"] = "constant"
    """After the warm-up. ``cosine`` falls to zero over the steps of the run. Source: MWM; MAE (cosine)."""
    precision: Precision = "fp32"
    """``bf16``: autocast; weights and optimizer stay in fp32. ``auto``: bf16 where the device has
    instructions for it, which the CPUs of most laptops have not."""
    accumulate: PositiveInt = 1
    """Parts of a batch that are worked on one after another, each in a fraction of the memory. A CPU takes
    parts of 50 to 99 rows by itself."""
    is_compiled: bool = False
    """Whether ``torch.compile`` makes the network ready first, which takes half a minute or more."""
    ema_decay: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Of the running mean of the weights, which is then validated and handed on; 0: the weights themselves.
    Source: ours, off."""


@config
class PretrainConfig:
    """One pretraining run."""

    steps: PositiveInt = 5000
    """Gradient steps. Source: MWM configs.yaml (mae_pretrain); the paper does not say."""
    seed: int = 0
    batch_size: PositiveInt = 800
    """Frames of one gradient step, of all parts and all processes together: 16 x 50 of Table 2."""
    device: Annotated[str, Field(min_length=1)] = "cpu"
    """As PyTorch names them: ``cpu``, ``cuda``, ``cuda:1``."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    objects: ObjectMaskConfig = field(default_factory=ObjectMaskConfig)
    text: TextConfig = field(default_factory=TextConfig)
    mae: MAEConfig = field(default_factory=MAEConfig)
    optimizer: OptimConfig = field(default_factory=OptimConfig)
    ram_mib: PositiveInt = 4096
    """Decoded frames are kept in memory up to this much; what does not fit is read each time."""
    log_every: PositiveInt = 20
    valid_every: PositiveInt = 500
    """Steps between looks at the test split, each with a picture."""
    valid_frames: PositiveInt = 128
    checkpoint_every: PositiveInt = 1000


@config
class ProbeConfig:
    """One look at a pretrained autoencoder: what language does in it, and what its features know."""

    run: Annotated[str, Field(min_length=1)]
    """Folder of a pretraining run, or of a model."""
    data: Annotated[str, Field(min_length=1)]
    """Folder of a dataset with frames of both splits."""
    others: tuple[str, ...] = ()
    """Folders of datasets of the same scenes whose test frames hold out something else, such as textures
    alone: a row each in the table of what is seen and unseen."""
    frames: PositiveInt = 1000
    """At most so many of each split and dataset with a hidden object, and so many test frames of which
    features are read; the readers are fitted on four times as many training frames."""
    seed: int = 0
    """Of frames, boxes, captions, token masks, the random encoder and the intervals."""
    split: Literal["test", "train"] = "test"
    """Of the frames that the tables are about; the other split has a row beside it."""
    beside: str | None = None
    """Folder of another run, whose features are read beside."""
    device: Annotated[str, Field(min_length=1)] = "cpu"
    """As PyTorch names it."""
    ram_mib: PositiveInt = 1024
    """Decoded frames of each split are kept in memory up to this much."""
