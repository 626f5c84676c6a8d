"""What is probed: the model, the frames it is asked about, and whether they belong together.

Owns opening and checking. Nothing is measured here.
"""

from dataclasses import dataclass
from pathlib import Path

from langwm_data.config_io import CONFIG_FILE, ConfigError, load_config_file
from langwm_data.scenes.spec import Split
from langwm_data.scenes.splits import HeldOut, describe_held_out
from langwm_data.shards.manifest import Manifest
from pretrain.config import ObjectMaskConfig, PretrainConfig, ProbeConfig
from pretrain.dataset import FrameDataset, open_split
from pretrain.mae import LanguageGroundedMAE
from pretrain.model_file import Intrinsics, is_same_camera

TRAINING = "training frames"
"""Title of the frames of the training split."""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is probed, opened and checked."""

    config: ProbeConfig
    mae: LanguageGroundedMAE
    beside: LanguageGroundedMAE | None
    objects: ObjectMaskConfig
    splits: dict[Split, FrameDataset]
    """Of the dataset that readers are fitted on and most tables are about."""
    shown: dict[str, FrameDataset]
    """All sets of frames that language is measured on, by title; the splits are among them."""
    about: str
    """Title of the set that most tables are about."""
    model_splits: dict[str, str]
    """The split of each furniture model that some scene has on record."""


def open_subject(config: ProbeConfig) -> Subject:
    """Open the model, the run beside it and all datasets.

    Raises:
        ValueError: If one of them is missing or does not fit.
    """
    mae = LanguageGroundedMAE.from_pretrained(config.run).to(config.device)
    size = (mae.config.height, mae.config.width)
    beside = None
    if config.beside is not None:
        beside = LanguageGroundedMAE.from_pretrained(config.beside).to(config.device)
        other = (beside.config.height, beside.config.width)
        if other != size:
            raise ConfigError(
                f"--beside {config.beside!r} reads frames of {other[0]}x{other[1]};"
                f" {config.run!r} reads {size[0]}x{size[1]}"
            )
    splits: dict[Split, FrameDataset] = {}
    for split in ("test", "train"):
        splits[split] = _open(config, config.data, split, mae)
    others = [_open(config, name, "test", mae) for name in config.others]
    for name, frames in zip(config.others, others, strict=True):
        _check_same_scenes(config.data, splits["train"].shards.manifest, name, frames.shards.manifest)
    model_splits = _model_splits([splits["train"], splits["test"], *others])
    titles = [_title(frames, model_splits) for frames in (*others, splits["test"])]
    if len(set(titles)) < len(titles):
        raise ConfigError(
            f"two of --data show the same kind of {max(titles, key=titles.count)}; give one of each kind"
        )
    return Subject(
        config=config,
        mae=mae,
        beside=beside,
        objects=_objects_of(Path(config.run)),
        splits=splits,
        shown={TRAINING: splits["train"], **dict(zip(titles, (*others, splits["test"]), strict=True))},
        about=titles[-1] if config.split == "test" else TRAINING,
        model_splits=model_splits,
    )


def split_of(title: str) -> Split:
    """The split of the frames of this title."""
    return "train" if title == TRAINING else "test"


def check_intrinsics(data: str, found: Intrinsics, expected: Intrinsics | None) -> None:
    """Refuse frames of another camera than the model knows: every depth in them would be off.

    Raises:
        ConfigError: If a focal length or the middle differs by more than half a pixel.
    """
    if expected is not None and not is_same_camera(found, expected):
        raise ConfigError(
            f"--data {data!r} was seen by a camera of {_camera_text(found)}; the model learned from one of"
            f" {_camera_text(expected)}, so its depths would be wrong there"
        )


def _open(config: ProbeConfig, data: str, split: Split, mae: LanguageGroundedMAE) -> FrameDataset:
    frames = open_split(Path(data), split, (mae.config.height, mae.config.width), config.ram_mib)
    if frames is None:
        raise ConfigError(
            f"--data {data!r} has no {split} frames; a probe needs those of both splits of the first dataset,"
            " since what it fits is fitted on training frames, and test frames of all others"
        )
    check_intrinsics(data, frames.intrinsics, mae.intrinsics)
    return frames


def _check_same_scenes(first: str, expected: Manifest, other: str, found: Manifest) -> None:
    """Refuse to compare what differs in more than what is held out."""
    seeds = [m.config.get("scenes", {}).get("seed") for m in (expected, found)]
    if seeds[0] != seeds[1] or expected.sources != found.sources:
        raise ConfigError(
            f"--data {other!r} is of other scenes than --data {first!r}: scenes.seed {seeds[1]} and"
            f" {len(found.sources)} sources of others, not {seeds[0]} and the same"
        )
    if not is_same_camera(expected.camera.K, found.camera.K):
        raise ConfigError(f"--data {other!r} was seen by another camera than --data {first!r}")


def _title(frames: FrameDataset, model_splits: dict[str, str]) -> str:
    """Such as ``test frames: unseen textures``; furniture counts where some of it is held out at all."""
    has_models = "test" in model_splits.values()
    unseen: list[HeldOut] = [
        what for what in frames.shards.manifest.holds_out if has_models or what != "models"
    ]
    return f"test frames: {describe_held_out(unseen)}"


def _objects_of(run: Path) -> ObjectMaskConfig:
    """Margins and how distances are said, as the run had them; the defaults for a model without its run."""
    path = run / CONFIG_FILE
    return load_config_file(PretrainConfig, path).objects if path.is_file() else ObjectMaskConfig()


def _model_splits(datasets: list[FrameDataset]) -> dict[str, str]:
    found: dict[str, str] = {}
    for frames in datasets:
        shards = frames.shards
        for name in set(shards.frames["scene"].to_pylist()):
            found |= {record.model: record.split for record in shards.scene(name).models}
    return found


def _camera_text(intrinsics: Intrinsics) -> str:
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    return f"focal lengths {fx:.1f}, {fy:.1f} and middle {cx:.1f}, {cy:.1f} px"
