"""The folder in which a pretrained autoencoder is handed on: ``config.json``, ``model.safetensors``.

Safetensors and JSON only: reading a model never runs code from it.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from langwm_data import atomic
from langwm_data.config_io import ConfigError, build_config, config_to_dict
from langwm_data.shards.writer import sha256_of
from pretrain.config import MAEConfig, TextConfig

SCHEMA_VERSION = 1
MODEL_FOLDER = "model"
_CONFIG = "config.json"
_WEIGHTS = "model.safetensors"


Intrinsics = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
"""Of a pinhole camera, pixels: depth that was learned through one is wrong through another."""


_TOLERANCE_PX = 0.5


Matrix = Sequence[Sequence[float]] | NDArray[np.floating]


def is_same_camera(first: Matrix, second: Matrix) -> bool:
    """Whether focal lengths and middle of two intrinsics (3, 3) agree within half a pixel."""
    return np.allclose(first, second, rtol=0, atol=_TOLERANCE_PX)


class ModelFile(NamedTuple):
    """What the two files hold."""

    mae: MAEConfig
    text: TextConfig
    tensors: dict[str, Tensor]
    intrinsics: Intrinsics | None
    """Of the frames that it was trained on; ``None`` where nobody said."""


def save_model_file(folder: Path, held: ModelFile) -> None:
    """Write both files, the weights first: a config stands for weights that are there.

    Raises:
        OSError: If the weights cannot be written, for instance on a full disk; what was there stays.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with atomic.atomic_path(folder / _WEIGHTS) as temporary:
        temporary.write_bytes(save({name: t.detach().cpu().contiguous() for name, t in held.tensors.items()}))
        (folder / _CONFIG).unlink(missing_ok=True)
    described = {
        "schema_version": SCHEMA_VERSION,
        "mae": config_to_dict(held.mae),
        "text": config_to_dict(held.text),
        "intrinsics": held.intrinsics,
        "weights_sha256": sha256_of(folder / _WEIGHTS),
    }
    atomic.write_json(folder / _CONFIG, described)


def find_model(name: Path | str) -> Path:
    """The folder of a model: that folder itself, or a copy of a repository of the Hugging Face hub.

    Raises:
        ValueError: If it is no folder, and the hub has no such repository or cannot be reached.
    """
    if Path(name).exists() or not isinstance(name, str) or not re.fullmatch(r"[\w.-]+/[\w.-]+", name):
        return Path(name)
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import HfHubHTTPError, LocalEntryNotFoundError

    try:
        return Path(snapshot_download(name, allow_patterns=[_CONFIG, _WEIGHTS]))
    except (HfHubHTTPError, LocalEntryNotFoundError, OSError) as error:
        raise ValueError(
            f"{name!r} holds no pretrained autoencoder: it is no folder here, and the Hugging Face hub does"
            f" not give it ({type(error).__name__})"
        ) from error


def load_model_file(folder: Path) -> ModelFile:
    """Read both files of ``folder``, or of the ``model`` folder inside it.

    Raises:
        ValueError: If they are missing, damaged, or of another schema version.
    """
    folder = _home(folder)
    if not (folder / _CONFIG).is_file():
        raise ValueError(f"{str(folder)!r} holds no pretrained autoencoder ({_CONFIG} and {_WEIGHTS})")
    try:
        held = json.loads((folder / _CONFIG).read_text("utf-8"))
        if "system" in held:
            raise ValueError(f"{str(folder)!r} holds an agent of train-agent, not a pretrained autoencoder")
        version = held["schema_version"]
        if version != SCHEMA_VERSION:
            raise ValueError(
                f"{folder / _CONFIG} has schema version {version}; this program reads {SCHEMA_VERSION}"
            )
        mae, text = build_config(MAEConfig, held["mae"]), build_config(TextConfig, held["text"])
        intrinsics = TypeAdapter(Intrinsics | None).validate_python(held.get("intrinsics"))
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, ConfigError) as error:
        raise ValueError(f"{folder / _CONFIG} does not describe a pretrained autoencoder: {error}") from error
    except ValidationError as error:
        raise ValueError(f"{folder / _CONFIG}: intrinsics are not three rows of three numbers") from error
    try:
        tensors = load_file(folder / _WEIGHTS)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{folder / _WEIGHTS} cannot be read: {error}") from error
    return ModelFile(mae, text, tensors, intrinsics)


def check_fit(folder: Path, expected: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> None:
    """Compare the names, shapes and types of weights with those that the config asks for.

    Raises:
        ValueError: Naming the first that differs.
    """
    for name in sorted({*expected, *found}):
        if _kind(expected.get(name)) != _kind(found.get(name)):
            raise ValueError(
                f"the {_WEIGHTS} in {str(folder)!r} does not fit its {_CONFIG}: {name} is"
                f" {_kind(found.get(name))}, not {_kind(expected.get(name))}"
            )


def check_bytes(folder: Path) -> None:
    """Refuse weights that are not those that were saved with their config, which may not say which those are.

    Raises:
        ValueError: If they differ.
    """
    folder = _home(folder)
    said = json.loads((folder / _CONFIG).read_text("utf-8")).get("weights_sha256")
    if said is not None and said != (found := sha256_of(folder / _WEIGHTS)):
        raise ValueError(
            f"{folder / _WEIGHTS} has sha256 {found[:12]}..., not {str(said)[:12]}... as its {_CONFIG} says:"
            " the weights were damaged or changed after they were saved"
        )


def _home(folder: Path) -> Path:
    """The folder of both files: that of a run has it inside."""
    return folder / MODEL_FOLDER if (folder / MODEL_FOLDER / _CONFIG).is_file() else folder


def _kind(tensor: Tensor | None) -> str:
    return "missing" if tensor is None else f"{tensor.dtype} {tuple(tensor.shape)}"
