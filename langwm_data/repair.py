"""Make again what is damaged in a dataset, and nothing else.

Owns what a repair may write: a shard only when its bytes come out as the manifest's checksum says, the
files beside the shards only after these. Sound samples keep their bytes; the others are rendered from the
baked scene.
"""

import dataclasses
import io
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from langwm_data import atomic
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig
from langwm_data.config_io import CONFIG_FILE
from langwm_data.frames import BakeTask, RenderWorker
from langwm_data.plan import FramePlan, plan_frame, plan_shards
from langwm_data.redraw import require_same_generator
from langwm_data.scenes.assets import ASSETS_DIR
from langwm_data.shards.card import write_card
from langwm_data.shards.findings import Finding
from langwm_data.shards.index import FRAMES_SCHEMA, OBJECTS_SCHEMA, frame_row, object_rows
from langwm_data.shards.manifest import (
    CARD_FILE,
    FRAMES_FILE,
    OBJECTS_FILE,
    Manifest,
    ShardRecord,
    read_manifest,
    write_manifest,
)
from langwm_data.shards.sample import DatasetError, decode_sample, encode_sample
from langwm_data.shards.scenes import SCENES_DIR, read_models, read_scene, scene_file, scene_path
from langwm_data.shards.tar_walk import walk_samples
from langwm_data.shards.writer import TarWriter, sha256_of, shard_path, write_table

_OTHER_SHA256 = (
    "made again it has another SHA-256 than the manifest says, so it stays as it was;"
    " render the dataset again"
)

Places = Mapping[str, Mapping[str, tuple[int, int]]]
"""Key of a sample to its files' offsets and sizes in a tar."""


def repair_dataset(
    path: Path | str, findings: Collection[Finding], *, progress: Callable[[int, int], None] | None = None
) -> list[str]:
    """Make every file again in which something was found.

    Args:
        path: Folder that holds ``dataset.json``.
        findings: What ``verify_dataset`` or ``redraw_frames`` found.
        progress: Called with shards done and shards to make.

    Returns:
        The files that were made again, relative to the dataset. What is no part of the dataset is left
        there; whoever wants to know whether all is well now verifies again.

    Raises:
        DatasetError: If the dataset was made by another version or renderer, or what is made again is
            not what was there. What was made again before that stays.
    """
    folder = Path(path)
    manifest = read_manifest(folder)
    config = require_same_generator(manifest)
    _refuse_links(folder, manifest)
    damaged = {finding.where for finding in findings}
    names = sorted({name for split in manifest.splits.values() for name in split.scenes})
    scenes = [name for name in names if scene_file(name) in damaged]
    scenes += _scenes_with_damaged_assets(folder, set(names) - set(scenes), damaged)
    if scenes and dict(open_scenes(config.scenes, config.splits.holds_out).identity) != manifest.sources:
        raise DatasetError(
            f"{folder}: its scenes were made from other files than those that its configuration names now"
        )
    shards = [shard for shard in manifest.shards if shard.path in damaged]
    with RenderWorker(config, folder) as worker:
        for name in scenes:
            _repair_scene(folder, manifest, name, worker)
        for done, shard in enumerate(shards, start=1):
            bad = {finding.key for finding in findings if finding.where == shard.path}
            _repair_shard(folder, shard, config, worker, bad)
            if progress is not None:
                progress(done, len(shards))
    made = [*map(scene_file, scenes), *(shard.path for shard in shards)]
    return made + _repair_descriptions(folder, manifest, damaged)


def _scenes_with_damaged_assets(folder: Path, names: Collection[str], damaged: Collection[str]) -> list[str]:
    """Scenes that need a mesh or picture in which something was found, which is removed."""
    if not any(where.startswith(f"{ASSETS_DIR}/") for where in damaged):
        return []
    needing = []
    for name in sorted(names):
        lost = {f"{ASSETS_DIR}/{file}" for file in read_scene(folder, name).assets()} & set(damaged)
        needing += [name] if lost else []
        for where in lost:
            (folder / where).unlink(missing_ok=True)
    return needing


def _refuse_links(folder: Path, manifest: Manifest) -> None:
    for name in (SCENES_DIR, ASSETS_DIR, Path(FRAMES_FILE).parent.name, *manifest.splits):
        if (folder / name).is_symlink():
            raise DatasetError(f"{folder / name} is a link to another folder, in which nothing is repaired")


def _repair_scene(folder: Path, manifest: Manifest, name: str, worker: RenderWorker) -> None:
    """Settle a floor again.

    Raises:
        DatasetError: If it comes out otherwise than the checksum says; the file stays as it was.
    """
    path = scene_path(folder, name)
    before = path.read_bytes() if path.is_file() else None
    worker(BakeTask(scene=name, physics=manifest.physics), lambda _: None)
    if sha256_of(path) != manifest.files.get(scene_file(name)):
        path.unlink()
        if before is not None:
            atomic.write_bytes(path, before)
        raise DatasetError(f"{path}: {_OTHER_SHA256}")


def _repair_shard(
    folder: Path, record: ShardRecord, config: DatasetConfig, worker: RenderWorker, bad: Collection[str]
) -> None:
    """Keep the sound samples of a shard and render the others; where that is not enough, render all.

    Raises:
        DatasetError: If even then the bytes are not those of the checksum; the file stays as it was.
    """
    path = folder / record.path
    task = next((t for t in plan_shards(config) if shard_path(t.split, t.number) == record.path), None)
    if task is None:
        raise DatasetError(f"{path} is no shard of the dataset's configuration")
    plans = [plan_frame(config, task.split, number) for number in range(task.start, task.stop)]
    for sound in (_sound_samples(path, bad), {}):
        with suppress(_OtherBytesError), atomic.atomic_path(path) as temporary:
            with temporary.open("wb") as file:
                tar = TarWriter(file)
                for key, name, data in _files(path, plans, sound, worker):
                    tar.add(f"{key}.{name}", data)
                if tar.finish() != record.sha256:
                    raise _OtherBytesError
            return
    raise DatasetError(f"{path}: {_OTHER_SHA256}")


class _OtherBytesError(Exception):
    """What was made again is not what was there."""


def _sound_samples(path: Path, bad: Collection[str]) -> Places:
    """The samples of a shard in which nothing was found, up to where the tar cannot be read."""
    places = {}
    if path.is_file():
        with path.open("rb") as file, suppress(DatasetError):
            for raw in walk_samples(file.read):
                if not raw.faults and raw.key not in bad:
                    places[raw.key] = raw.places
    return places


def _files(
    path: Path, plans: list[FramePlan], sound: Places, worker: RenderWorker
) -> Iterator[tuple[str, str, bytes]]:
    """Key, file key and bytes of all files of a shard, in order."""
    for plan in plans:
        if plan.key in sound:
            with path.open("rb") as file:
                for name, (offset, size) in sound[plan.key].items():
                    file.seek(offset)
                    yield plan.key, name, file.read(size)
        else:
            for name, data in encode_sample(worker.make_sample(plan)).items():
                yield plan.key, name, data


def _repair_descriptions(folder: Path, manifest: Manifest, damaged: Collection[str]) -> list[str]:
    """Index, card and configuration, from shards that are sound by now and from the manifest."""
    made = []
    if FRAMES_FILE in damaged or OBJECTS_FILE in damaged:
        rewrite_index(folder, manifest)
        made += [FRAMES_FILE, OBJECTS_FILE]
    if CARD_FILE in damaged:
        write_card(folder, manifest, read_models(folder, manifest))
        made.append(CARD_FILE)
    if CONFIG_FILE in damaged:
        atomic.write_text(folder / CONFIG_FILE, yaml.safe_dump(manifest.config, sort_keys=False))
        made.append(CONFIG_FILE)
    return made


def rewrite_index(folder: Path, manifest: Manifest) -> None:
    """Make both tables of the index again from the shards, which have to be sound.

    Other versions of pyarrow write the same rows in other bytes; the manifest then has their checksum.
    """
    frames, objects = [], []
    for shard in manifest.shards:
        frame_part, object_part = [], []
        with (folder / shard.path).open("rb") as file:
            for raw in walk_samples(file.read):
                sample = decode_sample({"__key__": raw.key, **raw.files})
                frame_part.append(frame_row(sample, shard.path, raw.places))
                object_part += object_rows(sample)
        frames.append(_as_read(frame_part, FRAMES_SCHEMA))
        objects.append(_as_read(object_part, OBJECTS_SCHEMA))
    write_table(folder / FRAMES_FILE, pa.concat_tables(frames))
    write_table(folder / OBJECTS_FILE, pa.concat_tables(objects))
    written = {name: sha256_of(folder / name) for name in (FRAMES_FILE, OBJECTS_FILE)}
    if manifest.files | written != manifest.files:
        write_manifest(folder, dataclasses.replace(manifest, files=manifest.files | written))


def _as_read(rows: list[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """The rows of one shard as they come back from its part of the index, to give the index's very bytes."""
    part = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema), part)
    return pq.ParquetFile(part).read()
