"""Frames of a dataset in the Rerun viewer: images, boxes, and each view as a cloud of points in its scene.

Owns what is logged under which name. Needs the extra ``rerun``.
"""

from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import numpy as np

from langwm_data.config_io import ConfigError
from langwm_data.scenes.taxonomy import is_structure
from langwm_data.shards.gallery import instance_color
from langwm_data.shards.sample import Sample


def show_frames(samples: Iterable[Sample], out_rrd: Path | None = None) -> None:
    """Open the viewer on ``samples``, one step of its time line each, or save them for it.

    Args:
        samples: What to show; views of one scene stand in one space.
        out_rrd: Recording to write instead of opening the viewer.

    Raises:
        ConfigError: If the Rerun SDK is not installed.
    """
    rr = import_rerun()
    rr.init("langwm", spawn=out_rrd is None)
    if out_rrd is not None:
        out_rrd.parent.mkdir(parents=True, exist_ok=True)
        rr.save(out_rrd)
    for step, sample in enumerate(samples):
        rr.set_time("frame", sequence=step)
        _log_frame(rr, sample)
    rr.disconnect()


def import_rerun() -> ModuleType:
    """The Rerun SDK.

    Raises:
        ConfigError: If it is not installed.
    """
    try:
        import rerun  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ConfigError("--rerun needs the Rerun SDK: pip install 'langwm[rerun]'") from error
    return rerun


def _log_frame(rr: ModuleType, sample: Sample) -> None:
    camera = sample.meta["camera"]
    pose = np.array(camera["camera_to_world"])
    rr.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    rr.log("scene/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
    rr.log(
        "scene/camera/image",
        rr.Pinhole(
            image_from_camera=camera["K"],
            resolution=(camera["width"], camera["height"]),
            camera_xyz=rr.ViewCoordinates.RDF,
        ),
    )
    rr.log("scene/camera/image/rgb", rr.Image(sample.rgb))
    rr.log("scene/camera/image/depth", rr.DepthImage(sample.depth, meter=1.0))
    rr.log("scene/camera/image/instance", rr.SegmentationImage(sample.instance))
    furniture = [obj for obj in sample.meta["objects"] if not is_structure(obj["category"])]
    boxes = np.array([obj["bbox_xyxy"] for obj in furniture]).reshape(-1, 4)
    rr.log(
        "scene/camera/image/objects",
        rr.Boxes2D(
            array=boxes,
            array_format=rr.Box2DFormat.XYXY,
            labels=[obj["phrase"] for obj in furniture],
            colors=[instance_color(obj["instance"]) for obj in furniture],
        ),
    )
    rr.log("caption", rr.TextDocument(f"{sample.key}\n\n{sample.caption}"))
