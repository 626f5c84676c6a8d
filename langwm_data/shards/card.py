"""The data card: a README that people read and whose head Hugging Face ``datasets`` reads."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from langwm_data import atomic
from langwm_data.scenes.spec import ModelRecord
from langwm_data.scenes.splits import EVERYTHING, describe_held_out
from langwm_data.shards.licence import is_igibson, licence_tags, licence_text
from langwm_data.shards.manifest import CARD_FILE, Manifest

_CAPTION = {
    "text": "string",
    "template": "int64",
    "rule": "int64",
    "direction": "string",
    "distance": "string",
}
_OBJECT = {
    "instance": "int64",
    "category": "string",
    "model": "string",
    "phrase": "string",
    "bbox_xyxy": ["float64"],
    "center_px": ["float64"],
    "area_px": "int64",
    "distance_m": "float64",
    "direction_rule1": "string",
    "direction_rule2": "string",
    "captions": [_CAPTION],
    "visible_fraction": "float64",
    "truncated_fraction": "float64",
    "occluded_fraction": "float64",
}
_CAMERA = {
    "height": "int64",
    "width": "int64",
    "K": [["float64"]],
    "camera_to_world": [["float64"]],
    "yaw_rad": "float64",
    "pitch_rad": "float64",
}
FEATURES: dict[str, Any] = {
    "rgb.png": "image",
    "depth.png": "image",
    "instance.png": "image",
    "json": {
        "scene": "string",
        "building": "string",
        "floor": "int64",
        "split": "string",
        "palette": ["string"],
        "lights": {name: ["float64"] for name in ("ambient", "sun", "lamp", "sun_direction")},
        "trajectory": "int64",
        "step": "int64",
        "action": ["float64"],
        "pose": ["float64"],
        "camera": _CAMERA,
        "objects": [_OBJECT],
    },
    "txt": "string",
    "__key__": "string",
    "__url__": "string",
}
"""Type of every field of a sample. Declared, because a reader that guesses from the first samples guesses
wrong where their lists happen to be empty."""

_BODY = """
# {title}

{frames} rendered views of {subject}, made by {generator} with the `{renderer}` renderer: colour,
metric depth, instance masks, and sentences that say which object lies in which direction and how far away.
{held_out}

| split | frames | floors |
|---|---|---|
{splits}

{objects} visible instances of {num_categories} categories, {captions} captions. Images are
{height} x {width} pixels (height x width).

## Files of a sample

- `rgb.png`: 8-bit colour.
- `depth.png`: 16-bit, millimetres along the optical axis (z-depth, not the length of the ray); 0 is invalid.
- `instance.png`: 16-bit instance ids; 0 is background. Walls, floors and ceilings have ids of their own.
- `json`: scene, split, materials (`palette`), camera and every visible object: box (pixel edges; right
  and bottom exclusive), centroid, area, mean depth, direction by both rules, captions, and three shares
  of its silhouette, which is what it would cover if it stood alone and the picture had no edges:
  `visible_fraction` is seen, `truncated_fraction` lies outside the picture, and of what lies inside,
  `occluded_fraction` is hidden by something else. `K` is in pixels with pixel centres at .5.
  `camera_to_world` is 4x4 in metres; camera axes are x right, y down, z forward; in the world z is up.
  `pose` is that of the robot under the camera: x and y in metres, yaw in radians, counter-clockwise from x.
  Frames of one drive share `trajectory`, its number in the split, and count their `step` from 0, every
  0.1 s; `action` is what led to the frame, forward speed / (0.5 m/s) and turning speed / (pi/2 rad/s, left
  positive), zeros at step 0. Where frames stand alone `trajectory` is -1.
  `lights` are the strengths of red, green and blue of each light of the home, where the renderer has them.
- `txt`: the caption of the largest captioned object, empty where there is none.

`index/frames.parquet` and `index/objects.parquet` have a row per frame and per visible object,
`scenes/*.json` the floors, `dataset.json` the whole configuration, the number of each category in
semantic masks (`category_ids`) and the checksum of each shard.

## Reading it

```python
from langwm_data import ShardDataset

dataset = ShardDataset("PATH")
sample = dataset[0]  # .rgb, .depth in metres, .instance, .meta, .caption
semantic = sample.semantic(dataset.manifest.category_ids)
```

```python
import webdataset as wds
from langwm_data.shards.sample import decode_sample

samples = wds.WebDataset("PATH/train/train-000000.tar", shardshuffle=False).map(decode_sample)
```

```python
import datasets, numpy as np

rows = datasets.load_dataset("PATH", split="train")
depth_m = np.asarray(rows[0]["depth.png"]) / 1000
```

**Depth and masks are 16-bit.** Decoders that turn every image into 8-bit RGB (`.decode("pil")`,
`.decode("rgb")` of `webdataset`, `.convert("RGB")` of Pillow) clip them at 255 without a word. Use
`decode_sample`, or read `depth.png` with a reader that keeps 16 bits (`cv2.IMREAD_UNCHANGED`,
Pillow's mode `I;16`).

`langwm export-coco PATH --out COCO` writes COCO files: instances, panoptic segments and captions.

## Licence

{licence}
"""


def write_card(folder: Path, manifest: Manifest, models: Sequence[ModelRecord]) -> None:
    """Write ``README.md``.

    Args:
        folder: Of the dataset.
        manifest: What it holds.
        models: Those of others that stand in its scenes: their licences ask for their authors' names.
    """
    head = yaml.safe_dump(card_head(manifest), sort_keys=False)
    atomic.write_text(folder / CARD_FILE, f"---\n{head}---\n{_body(manifest, models)}")


def card_head(manifest: Manifest) -> dict[str, Any]:
    """What Hugging Face reads of the card: licence, tags, which files to load, and as what."""
    files = [{"split": split, "path": f"{split}/*.tar"} for split in manifest.splits]
    return {
        "pretty_name": _title(manifest),
        **licence_tags(manifest),
        "language": ["en"],
        "task_categories": ["depth-estimation", "image-to-text"],
        "tags": ["webdataset", "embodied-ai", "synthetic"],
        "size_categories": [_size_category(manifest.frames)],
        "configs": [{"config_name": "default", "data_files": files}],
        "dataset_info": {"config_name": "default", "features": _as_list(FEATURES)},
    }


def _body(manifest: Manifest, models: Sequence[ModelRecord]) -> str:
    splits = [f"| {name} | {split.frames} | {len(split.scenes)} |" for name, split in manifest.splits.items()]
    return _BODY.format(
        title=_title(manifest),
        subject="furnished scenes of iGibson 1.0" if is_igibson(manifest) else "furnished homes",
        held_out=_held_out(manifest),
        licence=licence_text(manifest, models),
        frames=manifest.frames,
        generator=manifest.generator,
        renderer=manifest.renderer,
        splits="\n".join(splits),
        objects=manifest.objects,
        num_categories=len(manifest.categories),
        captions=manifest.captions,
        height=manifest.camera.height,
        width=manifest.camera.width,
    )


def _held_out(manifest: Manifest) -> str:
    if manifest.holds_out == EVERYTHING:
        return "Floors and texture ids of the test split do not occur in the training split."
    return (
        f"Its test frames show {describe_held_out(manifest.holds_out)}; in all else they show what training"
        " frames of the same seed do."
    )


def _title(manifest: Manifest) -> str:
    return "LanGWM views of iGibson 1.0" if is_igibson(manifest) else "LanGWM homes"


def _as_list(features: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Named features in the form that stands in a card."""
    return [{"name": name, **_typed(kind)} for name, kind in features.items()]


def _typed(kind: Any) -> dict[str, Any]:  # noqa: ANN401
    if isinstance(kind, str):
        return {"dtype": kind}
    if isinstance(kind, list):
        inner = _typed(kind[0])
        return {"list": inner.get("dtype") or inner.get("struct") or inner}
    return {"struct": _as_list(kind)}


def _size_category(frames: int) -> str:
    limits = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
    return next((name for limit, name in limits if frames < limit), "1M<n<10M")
