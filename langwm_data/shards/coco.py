"""A dataset in COCO's form, for the many tools that read it: instances, panoptic segments, captions.

    OUT/<split>/<key>.png                       colour
    OUT/annotations/instances_<split>.json      objects; masks as run lengths
    OUT/annotations/captions_<split>.json       sentences and what they were filled from
    OUT/annotations/panoptic_<split>.json       objects, walls, floors, ceilings
    OUT/annotations/panoptic_<split>/<key>.png  their segment ids
    OUT/done                                    written last: the export is complete

Annotations are written as frames are read: memory holds one frame, and of all others their rows of the
index, less than 3 kB each. An export without ``done`` is made again from the start.
"""

import dataclasses
import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TextIO, get_args

import numpy as np
from numpy.typing import NDArray

from langwm_data import atomic
from langwm_data.claim import Kind, claim_output
from langwm_data.config_io import ConfigError, config
from langwm_data.labels.amodal import AmodalExtent
from langwm_data.png import encode_png
from langwm_data.scenes.spec import Split
from langwm_data.scenes.taxonomy import is_structure
from langwm_data.shards.coco_panoptic import panoptic_image, segments_info
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.manifest import GENERATOR
from langwm_data.shards.sample import Sample

ANNOTATIONS_DIR = "annotations"
DONE_FILE = "done"
_KIND = Kind(writes=(ANNOTATIONS_DIR, DONE_FILE, *get_args(Split)))

_LICENSE = {"id": 1, "name": "Apache-2.0", "url": "https://www.apache.org/licenses/LICENSE-2.0"}

_EXTENT = tuple(field.name for field in dataclasses.fields(AmodalExtent))

_log = logging.getLogger(__name__)


@config
class CocoExport:
    """Everything that the files of an export depend on; stands in its ``config.yaml``."""

    format: Literal["coco"] = "coco"
    exporter: str = GENERATOR
    dataset: str
    """Fingerprint of the dataset."""


def export_coco(
    path: Path | str,
    out: Path,
    *,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the dataset at ``path`` into the folder ``out`` in COCO's form.

    Args:
        path: Folder of a finished dataset.
        out: Folder of the export; a finished export of the same dataset is left as it is.
        fresh: Throw away what an earlier run left in ``out``.
        progress: Called with frames done and frames in all.

    Returns:
        ``out``.

    Raises:
        ConfigError: If there is no finished dataset at ``path``, or ``out`` is a file, holds something
            else, or holds the dataset.
        OSError: If the disk is full or cannot be written.
    """
    dataset = ShardDataset(path)
    if dataset.path.resolve().is_relative_to(out.resolve()):
        raise ConfigError(f"--out {str(out)!r} holds the dataset itself; give a new folder")
    claim_output(out, CocoExport(dataset=dataset.manifest.fingerprint), _KIND, fresh=fresh)
    if (out / DONE_FILE).is_file():
        _log.info("the export at %s is complete; nothing to do", out)
        return out
    first_id = 1
    for split in dataset.manifest.splits:
        part = dataset.select(split=split)
        for image_id in _export_split(part, split, out, first_id):
            if progress is not None:
                progress(image_id, len(dataset))
        first_id += len(part)
    os.sync()  # the images, once for all of them
    atomic.write_text(out / DONE_FILE, "")
    return out


def run_lengths(instance: NDArray[np.uint16]) -> dict[int, list[int]]:
    """Every mask of an image as COCO's uncompressed counts: off, on, off, ..., column by column."""
    pixels = instance.ravel(order="F")
    starts = np.append(0, np.flatnonzero(pixels[1:] != pixels[:-1]) + 1)
    runs = np.column_stack([starts, np.append(starts[1:], pixels.size)])
    ids = pixels[starts]
    counts = {}
    for number in np.unique(ids).tolist():
        turns = np.append(runs[ids == number], pixels.size)
        counts[number] = np.diff(turns, prepend=0).tolist()
        if counts[number][-1] == 0:
            counts[number].pop()
    return counts


def _export_split(part: ShardDataset, split: Split, out: Path, first_id: int) -> Iterator[int]:
    """Write the files of one split; yields the id of each image that is written."""
    annotations = out / ANNOTATIONS_DIR
    images_dir, panoptic_dir = out / split, annotations / f"panoptic_{split}"
    images_dir.mkdir(parents=True, exist_ok=True)
    panoptic_dir.mkdir(parents=True, exist_ok=True)
    category_ids = part.manifest.category_ids
    with (
        _document(
            annotations / f"instances_{split}.json", part, first_id, _things(category_ids)
        ) as instances,
        _document(annotations / f"captions_{split}.json", part, first_id, _things(category_ids)) as captions,
        _document(
            annotations / f"panoptic_{split}.json", part, first_id, _categories(category_ids)
        ) as panoptic,
    ):
        for image_id, sample in enumerate(part, start=first_id):
            name, objects = f"{sample.key}.png", sample.meta["objects"]
            (images_dir / name).write_bytes(encode_png(sample.rgb))
            (panoptic_dir / name).write_bytes(encode_png(panoptic_image(sample.instance, objects)))
            instances.add_numbered(_instances(sample, image_id, category_ids))
            captions.add_numbered(_captions(sample, image_id, category_ids))
            segments = segments_info(objects, category_ids)
            panoptic.add({"image_id": image_id, "file_name": name, "segments_info": segments})
            yield image_id


def _categories(category_ids: Mapping[str, int]) -> list[dict[str, Any]]:
    """Objects, which are things, and walls, floors and ceilings, which are stuff."""
    return [
        {
            "id": number,
            "name": name,
            "supercategory": "building" if is_structure(name) else "object",
            "isthing": int(not is_structure(name)),
        }
        for name, number in category_ids.items()
    ]


def _things(category_ids: Mapping[str, int]) -> list[dict[str, Any]]:
    return _categories({name: number for name, number in category_ids.items() if not is_structure(name)})


def _instances(sample: Sample, image_id: int, category_ids: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    counts = run_lengths(sample.instance)
    for obj in sample.meta["objects"]:
        if is_structure(obj["category"]):
            continue
        x1, y1, x2, y2 = obj["bbox_xyxy"]
        yield {
            "image_id": image_id,
            "category_id": category_ids[obj["category"]],
            "segmentation": {"size": list(sample.instance.shape), "counts": counts[obj["instance"]]},
            "area": obj["area_px"],
            "bbox": [x1, y1, x2 - x1, y2 - y1],
            "iscrowd": 0,
            "instance": obj["instance"],
            **{name: obj[name] for name in _EXTENT},
        }


def _captions(sample: Sample, image_id: int, category_ids: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    """Every sentence with its slots; ``instance`` is the object that it is about."""
    for obj in sample.meta["objects"]:
        for caption in obj["captions"]:
            slots = {"object": obj["phrase"], **caption}
            yield {
                "image_id": image_id,
                "caption": slots.pop("text"),
                "instance": obj["instance"],
                "category_id": category_ids[obj["category"]],
                **slots,
            }


class _Entries:
    """The list that ends an open JSON document, written entry by entry."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._num = 0

    def add(self, entry: Mapping[str, Any]) -> None:
        self._file.write((",\n" if self._num else "\n") + _dumps(entry))
        self._num += 1

    def add_numbered(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Add entries with ids from 1: pycocotools takes 0 for "no match"."""
        for entry in entries:
            self.add({"id": self._num + 1, **entry})


@contextmanager
def _document(
    path: Path, part: ShardDataset, first_id: int, categories: list[dict[str, Any]]
) -> Iterator[_Entries]:
    """A COCO file whose annotations are written as they are made; there once all of them are."""
    manifest = part.manifest
    info = {
        "description": f"LanGWM homes, rendered by {manifest.generator} with {manifest.renderer}",
        "version": manifest.fingerprint,
    }
    head = {"info": info, "licenses": [_LICENSE], "categories": categories}
    size = {"height": manifest.camera.height, "width": manifest.camera.width}
    with atomic.atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(_dumps(head)[:-1] + ',"images":[')
        images = _Entries(file)
        for image_id, key in enumerate(part.keys, start=first_id):
            images.add({"id": image_id, "file_name": f"{key}.png", **size, "license": _LICENSE["id"]})
        file.write('],"annotations":[')
        yield _Entries(file)
        file.write("]}\n")


def _dumps(value: Any) -> str:  # noqa: ANN401
    return json.dumps(value, separators=(",", ":"), allow_nan=False)
