"""The index of a dataset: two tables, a row per frame and a row per visible object.

Owns the columns and how they are filled from samples. Both tables can be read by anything that reads
parquet; ``frames`` says where in which tar every file lies, so a sample is one read.
"""

import math
from collections.abc import Mapping
from typing import Any

import pyarrow as pa

from langwm_data.shards.sample import CAPTION_KEY, DEPTH_KEY, INSTANCE_KEY, META_KEY, RGB_KEY, Sample

COLUMN_OF_FILE = {
    RGB_KEY: "rgb",
    DEPTH_KEY: "depth",
    INSTANCE_KEY: "instance",
    META_KEY: "json",
    CAPTION_KEY: "txt",
}
"""File key to the stem of its columns ``<stem>_offset`` and ``<stem>_bytes``."""

FRAMES_SCHEMA = pa.schema(
    [
        ("key", pa.string()),
        ("split", pa.string()),
        ("shard", pa.string()),
        *((f"{stem}_{what}", pa.int64()) for stem in COLUMN_OF_FILE.values() for what in ("offset", "bytes")),
        ("scene", pa.string()),
        ("building", pa.string()),
        ("floor", pa.int32()),
        ("camera_x", pa.float64()),
        ("camera_y", pa.float64()),
        ("camera_z", pa.float64()),
        ("yaw_rad", pa.float64()),
        ("pitch_rad", pa.float64()),
        ("trajectory", pa.int32()),
        ("step", pa.int32()),
        ("action", pa.list_(pa.float64())),
        ("materials", pa.list_(pa.string())),
        ("num_objects", pa.int32()),
        ("num_captions", pa.int32()),
        ("caption", pa.string()),
    ]
)

OBJECTS_SCHEMA = pa.schema(
    [
        ("key", pa.string()),
        ("split", pa.string()),
        ("instance", pa.int32()),
        ("category", pa.string()),
        ("model", pa.string()),
        ("phrase", pa.string()),
        ("x1", pa.float64()),
        ("y1", pa.float64()),
        ("x2", pa.float64()),
        ("y2", pa.float64()),
        ("center_x", pa.float64()),
        ("center_y", pa.float64()),
        ("area_px", pa.int32()),
        ("visible_fraction", pa.float64()),
        ("truncated_fraction", pa.float64()),
        ("occluded_fraction", pa.float64()),
        ("distance_m", pa.float64()),
        ("bearing_rad", pa.float64()),
        ("direction_rule1", pa.string()),
        ("direction_rule2", pa.string()),
        (
            "captions",
            pa.list_(
                pa.struct(
                    [
                        ("text", pa.string()),
                        ("template", pa.int32()),
                        ("rule", pa.int32()),
                        ("direction", pa.string()),
                        ("distance", pa.string()),
                    ]
                )
            ),
        ),
    ]
)


def frame_row(sample: Sample, shard: str, places: Mapping[str, tuple[int, int]]) -> dict[str, Any]:
    """The row of one sample.

    Args:
        sample: The sample as it was written.
        shard: Path of its tar, relative to the dataset.
        places: Offset and size of the bytes of each file in that tar.
    """
    meta, camera = sample.meta, sample.meta["camera"]
    where = {}
    for key, stem in COLUMN_OF_FILE.items():
        where[f"{stem}_offset"], where[f"{stem}_bytes"] = places[key]
    x, y, z = (row[3] for row in camera["camera_to_world"][:3])
    return {
        "key": sample.key,
        "split": meta["split"],
        "shard": shard,
        **where,
        "scene": meta["scene"],
        "building": meta["building"],
        "floor": meta["floor"],
        "camera_x": x,
        "camera_y": y,
        "camera_z": z,
        "yaw_rad": camera["yaw_rad"],
        "pitch_rad": camera["pitch_rad"],
        "trajectory": meta["trajectory"],
        "step": meta["step"],
        "action": meta["action"],
        "materials": meta["palette"],
        "num_objects": len(meta["objects"]),
        "num_captions": sum(len(o["captions"]) for o in meta["objects"]),
        "caption": sample.caption,
    }


def object_rows(sample: Sample) -> list[dict[str, Any]]:
    """The rows of everything visible in one sample.

    ``bearing_rad`` is the angle of the centroid from the optical axis in the camera's horizontal
    plane, left positive.
    """
    intrinsics = sample.meta["camera"]["K"]
    focal_px, middle_px = intrinsics[0][0], intrinsics[0][2]
    rows = []
    for obj in sample.meta["objects"]:
        x1, y1, x2, y2 = obj["bbox_xyxy"]
        center_x, center_y = obj["center_px"]
        rows.append(
            {
                "key": sample.key,
                "split": sample.meta["split"],
                "x1": x1,
                "y1": y1,
                "x2": x2,
                "y2": y2,
                "center_x": center_x,
                "center_y": center_y,
                "bearing_rad": math.atan2(middle_px - center_x, focal_px),
                **{name: obj[name] for name in OBJECTS_SCHEMA.names if name in obj},
            }
        )
    return rows
