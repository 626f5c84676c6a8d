"""Whether a pretrained autoencoder learned what a system says it did."""

import logging
import math
from pathlib import Path

from agent.config import FinetuneConfig
from langwm_data.config import CameraConfig
from langwm_data.config_io import CONFIG_FILE, ConfigError, load_config_file
from langwm_data.sim.camera import Camera
from pretrain.config import ObjectMaskConfig, PretrainConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.model_file import MODEL_FOLDER, is_same_camera

log = logging.getLogger(__name__)


def load_mae(name: str, system: str, wanted: FinetuneConfig) -> LanguageGroundedMAE:
    """The autoencoder of a pretraining run, if it is what ``system`` is about.

    The model says what it fills in; what was hidden and told stands in the ``config.yaml`` of its run. Where
    there is none, as beside a model from the hub, nobody can tell: a warning says so.

    Args:
        name: Folder of the run or of its model, or a repository of the Hugging Face hub.
        system: Who asks.
        wanted: The system's own way of learning the autoencoder.

    Raises:
        ConfigError: If it was pretrained otherwise.
        ValueError: If there is none, or it is damaged.
    """
    mae = LanguageGroundedMAE.from_pretrained(name)
    differences = _differences("model.target", mae.config.target, wanted.model.target)
    objects = _pretrained_objects(Path(name))
    if objects is None:
        log.warning("--mae %s does not say which objects it hid and told of; taken as %s", name, system)
    else:
        differences += _differences("objects.hides", objects.hides, wanted.objects.hides)
        differences += _differences("objects.captions", objects.captions, wanted.objects.captions)
    if differences:
        raise ConfigError(
            f"--mae {name!r} was not pretrained as system {system!r} says: {'; '.join(differences)};"
            " give another --mae, or another system"
        )
    return mae


def check_camera(mae: LanguageGroundedMAE, camera: CameraConfig) -> None:
    """Refuse to show an autoencoder frames of another camera than it learned through.

    Raises:
        ConfigError: If the focal lengths differ by more than half a pixel: sizes and depths would not fit.
    """
    seen = Camera.on_robot(camera, (0.0, 0.0), 0.0).intrinsics
    if mae.intrinsics is None or is_same_camera(seen, mae.intrinsics):
        return
    learned = math.degrees(2 * math.atan(camera.height / 2 / mae.intrinsics[0][0]))
    raise ConfigError(
        f"env.camera.vertical_fov_deg is {camera.vertical_fov_deg:g} but the MAE learned through a camera of"
        f" {learned:.1f}; make them equal"
    )


def _differences(field: str, found: object, wanted: object) -> list[str]:
    return [] if found == wanted else [f"{field} is {found!r} there and finetune.{field} is {wanted!r}"]


def _pretrained_objects(folder: Path) -> ObjectMaskConfig | None:
    run = folder.parent if folder.name == MODEL_FOLDER else folder
    path = run / CONFIG_FILE
    return load_config_file(PretrainConfig, path).objects if path.is_file() else None
