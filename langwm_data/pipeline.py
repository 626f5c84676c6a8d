"""Render a dataset: plan, workers, shards, index, manifest. Safe to stop and start again anywhere."""

import hashlib
import json
import logging
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from langwm_data import __version__, atomic
from langwm_data.config import DatasetConfig
from langwm_data.config_io import claim_output, config_to_dict
from langwm_data.frames import BakeTask, RenderWorker, scene_file
from langwm_data.plan import SPLITS, ShardTask, plan_shards, scenes_needed
from langwm_data.shards.card import write_card
from langwm_data.shards.manifest import (
    FRAMES_FILE,
    MANIFEST_FILE,
    OBJECTS_FILE,
    SCENES_DIR,
    CameraRecord,
    Manifest,
    ShardRecord,
    SplitRecord,
    write_manifest,
)
from langwm_data.shards.sample import MILLIMETRES
from langwm_data.shards.writer import WORK_DIR, complete_shard, read_parts, shard_path, write_table
from langwm_data.sim.camera import Camera
from langwm_data.workers import WorkerPool

GENERATOR = f"langwm {__version__}"

_log = logging.getLogger(__name__)


def render_dataset(
    config: DatasetConfig,
    out: Path,
    *,
    workers: int = 1,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render the dataset that ``config`` describes into the folder ``out``.

    Same config, same bytes in every shard, for any number of workers. When a dataset was begun in
    ``out``, complete shards are kept and the rest is made; when it is finished, nothing is done.

    Args:
        config: What to render.
        out: Folder of the dataset; made if missing.
        workers: Processes. More than one needs a script guarded by ``if __name__ == "__main__":``.
        fresh: Throw away what is in ``out`` and start over.
        progress: Called with frames done and frames in all.

    Returns:
        ``out``.

    Raises:
        ConfigError: If ``out`` holds something else, or ``config`` cannot be rendered.
        OSError: If the disk is full or cannot be written; complete shards are kept.
        ChildProcessError: If a worker process is killed; complete shards are kept.
    """
    claim_output(out, config, fresh=fresh)
    if (out / MANIFEST_FILE).is_file():
        _log.info("the dataset at %s is complete; nothing to do", out)
        return out
    _discard_other_work(out, fingerprint(config))
    tasks = plan_shards(config)
    todo = [t for t in tasks if complete_shard(out, shard_path(t.split, t.number)) is None]
    if len(todo) < len(tasks):
        _log.info("%d of %d shards are there; going on with the rest", len(tasks) - len(todo), len(tasks))
    _render(config, out, todo, workers, progress or _ignore)
    _finish(config, out, tasks)
    return out


def fingerprint(config: DatasetConfig) -> str:
    """SHA-256 over everything that the bytes of the shards depend on."""
    value = {"config": config_to_dict(config), "generator": GENERATOR, "renderer": config.render.backend}
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _discard_other_work(out: Path, mark: str) -> None:
    """Keep unfinished work only if this very program began it."""
    path = out / WORK_DIR / "fingerprint"
    if path.is_file() and path.read_text("utf-8") == mark:
        return
    for name in (WORK_DIR, SCENES_DIR, *SPLITS):
        shutil.rmtree(out / name, ignore_errors=True)
    atomic.write_text(path, mark)


def _render(
    config: DatasetConfig,
    out: Path,
    todo: list[ShardTask],
    workers: int,
    progress: Callable[[int, int], None],
) -> None:
    if not todo:
        return
    bake = [BakeTask(scene=s) for s in scenes_needed(config) if not scene_file(out, s).is_file()]
    done = config.frames - sum(task.stop - task.start for task in todo)

    def report(count: int) -> None:
        nonlocal done
        done += count
        progress(done, config.frames)

    progress(done, config.frames)
    num_workers = min(workers, max(len(todo), len(bake)))
    with WorkerPool(partial(RenderWorker, config, out), num_workers) as pool:
        pool.run(bake, _ignore)
        pool.run(todo, report)


def _finish(config: DatasetConfig, out: Path, tasks: list[ShardTask]) -> None:
    """Put the index together, describe the dataset, and last of all declare it complete."""
    records = []
    for task in tasks:
        record = complete_shard(out, shard_path(task.split, task.number))
        assert record is not None, task
        records.append(record)
    frames, objects = read_parts(out, records)
    write_table(out / FRAMES_FILE, frames)
    write_table(out / OBJECTS_FILE, objects)
    manifest = _describe(config, records, frames, objects)
    write_card(out, manifest)
    _remove_leftovers(out)
    write_manifest(out, manifest)
    shutil.rmtree(out / WORK_DIR)


def _describe(
    config: DatasetConfig, records: list[ShardRecord], frames: pa.Table, objects: pa.Table
) -> Manifest:
    camera = Camera.on_robot(config.camera, (0.0, 0.0), 0.0)
    splits = {}
    for split in SPLITS:
        part = frames.filter(pc.field("split") == split)
        if len(part):
            splits[split] = SplitRecord(frames=len(part), scenes=_counts(part["scene"]))
    return Manifest(
        generator=GENERATOR,
        fingerprint=fingerprint(config),
        renderer=config.render.backend,
        config=config_to_dict(config),
        camera=CameraRecord(
            height=camera.height,
            width=camera.width,
            K=camera.intrinsics.tolist(),
            depth_unit_m=1 / MILLIMETRES,
        ),
        categories=_counts(objects["category"]),
        splits=splits,
        frames=len(frames),
        objects=len(objects),
        captions=sum(frames["num_captions"].to_pylist()),
        shards=records,
    )


def _counts(column: pa.ChunkedArray) -> dict[str, int]:
    counts = {entry["values"]: entry["counts"] for entry in column.value_counts().to_pylist()}
    return dict(sorted(counts.items()))


def _remove_leftovers(out: Path) -> None:
    """Remove temporary files of jobs that were killed."""
    for path in out.rglob(".*.tmp"):
        path.unlink(missing_ok=True)


def _ignore(*_: int) -> None:
    """Report to nobody."""
