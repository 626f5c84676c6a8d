"""From complete shards to a dataset: the index put together, the data card, and the manifest last."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from langwm_data.labels.semantic import CATEGORY_IDS
from langwm_data.shards.card import write_card
from langwm_data.shards.manifest import (
    FRAMES_FILE,
    OBJECTS_FILE,
    CameraRecord,
    Manifest,
    ShardRecord,
    SplitRecord,
    write_manifest,
)
from langwm_data.shards.scenes import read_models, scene_file
from langwm_data.shards.writer import WORK_DIR, read_parts, sha256_of, write_table


@dataclass(frozen=True, kw_only=True)
class Origin:
    """How a dataset was made; stands in its manifest."""

    generator: str
    fingerprint: str
    physics: str
    renderer: str
    config: dict[str, Any]
    camera: CameraRecord
    sources: dict[str, str] = field(default_factory=dict)


def finish_dataset(folder: Path, records: Sequence[ShardRecord], origin: Origin) -> Manifest:
    """Make a dataset of the shards that ``records`` name; only now does it count as one."""
    frames, objects = read_parts(folder, records)
    write_table(folder / FRAMES_FILE, frames)
    write_table(folder / OBJECTS_FILE, objects)
    splits = _splits(frames)
    scenes = sorted({name for split in splits.values() for name in split.scenes})
    files = [*(scene_file(name) for name in scenes), FRAMES_FILE, OBJECTS_FILE]
    manifest = Manifest(
        generator=origin.generator,
        fingerprint=origin.fingerprint,
        physics=origin.physics,
        renderer=origin.renderer,
        config=origin.config,
        sources=origin.sources,
        camera=origin.camera,
        categories=_counts(objects["category"]),
        category_ids=dict(CATEGORY_IDS),
        splits=splits,
        frames=len(frames),
        objects=len(objects),
        captions=sum(frames["num_captions"].to_pylist()),
        files={name: sha256_of(folder / name) for name in files},
        shards=list(records),
    )
    write_card(folder, manifest, read_models(folder, manifest))
    write_manifest(folder, manifest)
    remove_work(folder)
    return manifest


def remove_work(folder: Path) -> None:
    """Remove what a finished dataset needs no more, and what jobs that were killed left.

    Whoever misses something because of it finds a manifest: so it comes after that.
    """
    for leftover in folder.rglob(".*.tmp"):
        leftover.unlink(missing_ok=True)
    shutil.rmtree(folder / WORK_DIR, ignore_errors=True)


def _splits(frames: pa.Table) -> dict[Any, SplitRecord]:
    splits = {}
    for name in dict.fromkeys(frames["split"].to_pylist()):
        part = frames.filter(pc.field("split") == name)
        splits[name] = SplitRecord(frames=len(part), scenes=_counts(part["scene"]))
    return splits


def _counts(column: pa.ChunkedArray) -> dict[str, int]:
    counts = {entry["values"]: entry["counts"] for entry in column.value_counts().to_pylist()}
    return dict(sorted(counts.items()))
