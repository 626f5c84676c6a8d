"""Everything that can be configured about stage one: scenes, camera, labels, shards."""

from dataclasses import field
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from langwm_data.config_io import ConfigError, config
from langwm_data.numbers import Fraction, Positive, PositiveInt
from langwm_data.scenes.splits import EVERYTHING, HeldOut


@config
class CameraConfig:
    """Pinhole camera on the robot. Source: Table 2 (size); iGibson turtlebot_point_nav.yaml (fov)."""

    height: Annotated[int, Field(ge=16, le=2048)] = 128
    """Pixels."""
    width: Annotated[int, Field(ge=16, le=2048)] = 160
    """Pixels."""
    vertical_fov_deg: Annotated[float, Field(ge=5, le=150)] = 45.0
    mount_height_m: Positive = 0.3
    """Above the floor. Source: ROS TurtleBot description, approximately."""
    pitch_deg: Annotated[float, Field(ge=-89, le=89)] = 0.0
    """Positive looks up."""
    near_m: Positive = 0.05
    far_m: Positive = 40.0

    def __post_init__(self) -> None:
        """Refuse a camera that sees nothing."""
        if self.near_m >= self.far_m:
            raise ConfigError(f"camera.near_m {self.near_m} must be less than camera.far_m {self.far_m}")


@config
class RobotConfig:
    """Cylinder that stands for the robot. Source: TurtleBot 2 (radius); the rest ours."""

    radius_m: Positive = 0.176
    height_m: Positive = 0.45
    clearance_m: Annotated[float, Field(ge=0)] = 0.03
    """It drives over what is no higher than this, such as a rug."""

    def __post_init__(self) -> None:
        """Refuse a robot that would drive over everything it meets."""
        if self.clearance_m >= self.height_m:
            raise ConfigError(
                f"robot.clearance_m {self.clearance_m} must be less than robot.height_m {self.height_m}"
            )


@config
class ScenesConfig:
    """Where scenes come from."""

    seed: int = 0
    """Seed of the procedural homes: same seed, same fifteen floors."""
    furniture: str | None = None
    """Folder of Sweet Home 3D catalogues (``.sh3f``): their models stand in the homes in the place of
    procedural ones of the same kind."""
    igibson: str | None = None
    """Folder of a licensed copy of the iGibson 1.0 dataset: its fifteen scenes in the place of homes."""
    baked: str | None = None
    """Folder of a finished dataset of these scenes: its floors are read instead of being settled again. Of
    scenes made from files of others it needs no more than this."""

    def __post_init__(self) -> None:
        """Refuse two kinds of scenes at once."""
        if self.furniture is not None and self.igibson is not None:
            raise ConfigError(
                f"scenes.furniture {self.furniture!r} is for homes; it cannot be given with scenes.igibson"
            )

    @property
    def folders(self) -> tuple[str | None, ...]:
        """All that are read; None where one is not given."""
        return self.furniture, self.igibson, self.baked


@config
class SplitsConfig:
    """How frames are divided between training and test floors."""

    test_fraction: Fraction = 0.1
    holds_out: tuple[HeldOut, ...] = EVERYTHING
    """What test frames show that training frames do not; in all else they show what training frames do.
    Source: ours (ADR-0015)."""

    def __post_init__(self) -> None:
        """Refuse names in another order, or twice, and frames that two floors of one name would share."""
        if self.holds_out != tuple(what for what in EVERYTHING if what in self.holds_out):
            raise ConfigError(
                f"splits.holds_out {list(self.holds_out)} is not some of {list(EVERYTHING)}, in this order"
            )
        if "buildings" not in self.holds_out and self.test_fraction != 1:
            raise ConfigError(
                f"splits.holds_out {list(self.holds_out)} without buildings needs splits.test_fraction 1, not"
                f" {self.test_fraction}: its frames are of floors that the training split has too"
            )


@config
class LightsConfig:
    """How bright the lights of a home are. Where their sum exceeds 1 a texture looks as it was drawn.

    Source: ours (ADR-0008). ``tiny`` has lights of its own.
    """

    ambient: Annotated[float, Field(ge=0)] = 0.45
    """From everywhere, a little more from above."""
    sun: Annotated[float, Field(ge=0)] = 0.2
    """From one direction, the same in all rooms."""
    lamp: Annotated[float, Field(ge=0)] = 0.6
    """From a lamp under the middle of each room's ceiling."""


@config
class RenderConfig:
    """How a scene becomes pixels."""

    backend: Literal["auto", "gl", "embree", "tiny"] = "auto"
    """``gl``: OpenGL through EGL, on a GPU or in software; ``embree``: ray casting on the CPU;
    ``tiny``: PyBullet's TinyRenderer; ``auto``: ``gl`` where it opens, else ``embree``."""
    egl_device: Annotated[int, Field(ge=0)] = 0
    """Which of the machine's EGL devices ``gl`` draws on."""
    texture_px: Literal[16, 32, 64, 128, 256] = 128
    """Texture pixels to a metre of surface."""
    is_antialiased: bool = True
    """Whether ``gl`` and ``embree`` take the mean of four samples where a pixel sees several faces."""
    lights: LightsConfig = field(default_factory=LightsConfig)


@config
class ViewsConfig:
    """Where dataset cameras stand and look. Source: ours, except where said."""

    mode: Literal["single", "trajectory"] = "single"
    """``single``: every frame from a place of its own; ``trajectory``: consecutive frames of a drive."""
    frames_per_palette: PositiveInt = 25
    """Consecutive frames that share one scene and one choice of textures; whole trajectories in any case."""
    trajectory_length: PositiveInt = 25
    """Frames of one drive, 0.1 s apart; read in mode ``trajectory``."""
    min_clearance_m: Positive = 0.25
    """Least distance from the camera to any obstacle, in the plane; not less than ``camera.near_m``."""
    uniform_fraction: Fraction = 0.2
    """Share of single views in a uniform direction, whatever they show; the others are turned towards an
    object in sight."""
    max_tries: PositiveInt = 20
    """Views turned towards an object that are drawn before one without an eligible object is accepted."""

    @property
    def frames_per_block(self) -> int:
        """Consecutive frames of one scene: ``frames_per_palette``, filled up to whole trajectories."""
        unit = 1 if self.mode == "single" else self.trajectory_length
        return -(-self.frames_per_palette // unit) * unit


def _ascending(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError("give the lower limit first")
    return limits


_Kelvin = Annotated[float, Field(ge=2222, le=25000)]


@config
class LightLimits:
    """Between what lights are drawn. Source: ours (ADR-0013)."""

    light_factor: Annotated[tuple[Positive, Positive], AfterValidator(_ascending)] = (0.6, 1.2)
    """Limits of what the strength of each light is multiplied by."""
    light_temperature_k: Annotated[tuple[_Kelvin, _Kelvin], AfterValidator(_ascending)] = (3500.0, 9000.0)
    """Limits of the colour temperature of each light, kelvin; 6500 is about white."""


@config
class RandomizeConfig(LightLimits):
    """How often materials and lights are drawn anew, and from what. Source: ours (ADR-0013)."""

    palette: Literal["block", "frame"] = "block"
    """``block``: for ``cameras.frames_per_palette`` frames; ``frame``: for each."""
    lights: Literal["fixed", "block", "frame"] = "fixed"
    """``fixed``: as ``render.lights`` says; else drawn around it, recorded with every frame."""


@config
class LabelsConfig:
    """What counts as an object worth a caption, and how its distance is said."""

    min_area_fraction: Fraction = 0.005
    """Smaller masks get no caption. Source: ours (method notes, decision 13)."""
    max_depth_m: Positive = 10.0
    """Depth is clipped here before the mean distance is taken."""
    distance_format: Literal["integer", "decimal"] = "integer"
    """``integer``: rounded metres; ``decimal``: one decimal."""


_MAX_SHARDS = 900_000
"""Of both splits: names of shards have six digits."""


@config
class ShardsConfig:
    """How samples are packed."""

    samples_per_shard: PositiveInt = 1000


@config
class DatasetConfig:
    """One rendered dataset."""

    frames: PositiveInt = 1000
    """All frames, training and test together."""
    seed: int = 0
    camera: CameraConfig = field(default_factory=CameraConfig)
    robot: RobotConfig = field(default_factory=RobotConfig)
    scenes: ScenesConfig = field(default_factory=ScenesConfig)
    splits: SplitsConfig = field(default_factory=SplitsConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    randomize: RandomizeConfig = field(default_factory=RandomizeConfig)
    cameras: ViewsConfig = field(default_factory=ViewsConfig)
    labels: LabelsConfig = field(default_factory=LabelsConfig)
    shards: ShardsConfig = field(default_factory=ShardsConfig)

    def __post_init__(self) -> None:
        """Refuse what cannot be rendered, or would not be what it says."""
        if self.frames > _MAX_SHARDS * self.shards.samples_per_shard:
            raise ConfigError(
                f"frames {self.frames} with shards.samples_per_shard {self.shards.samples_per_shard} make"
                f" more than {_MAX_SHARDS} shards; allowed: larger shards or fewer frames"
            )
        holds_out = list(self.splits.holds_out)
        if self.splits.holds_out != EVERYTHING:
            if self.scenes.igibson is not None:
                raise ConfigError(f"splits.holds_out {holds_out} is for homes, not for scenes.igibson")
            if "models" in holds_out and self.scenes.furniture is None:
                raise ConfigError(
                    f"splits.holds_out {holds_out} needs scenes.furniture: both splits show the same"
                    " procedural furniture"
                )
        if self.randomize.lights != "fixed" and self.render.backend == "tiny":
            raise ConfigError(
                f"randomize.lights {self.randomize.lights} needs render.backend auto, gl or embree"
            )
        if self.cameras.min_clearance_m < self.camera.near_m:
            raise ConfigError(
                f"cameras.min_clearance_m {self.cameras.min_clearance_m} must not be less than"
                f" camera.near_m {self.camera.near_m}"
            )
