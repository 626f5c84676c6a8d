"""Render a dataset: plan, workers, shards, index, manifest. Safe to stop and start again anywhere."""

import dataclasses
import hashlib
import json
import logging
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

from langwm_data import atomic
from langwm_data.config import DatasetConfig
from langwm_data.config_io import claim_output, config_to_dict
from langwm_data.frames import BakeTask, RenderWorker
from langwm_data.plan import SPLITS, ShardTask, plan_shards, scenes_needed
from langwm_data.shards.finish import Origin, finish_dataset
from langwm_data.shards.manifest import GENERATOR, MANIFEST_FILE, SCHEMA_VERSION, CameraRecord
from langwm_data.shards.sample import MILLIMETRES
from langwm_data.shards.scenes import SCENES_DIR, scene_path
from langwm_data.shards.writer import WORK_DIR, complete_shard, shard_path
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import describe_renderer, resolve_backend
from langwm_data.workers import WorkerPool

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
    mark = fingerprint(config)  # refuses a renderer that does not open, before anything is written
    claim_output(out, config, fresh=fresh)
    if (out / MANIFEST_FILE).is_file():
        _log.info("the dataset at %s is complete; nothing to do", out)
        return out
    _discard_other_work(out, mark)
    tasks = plan_shards(config)
    todo = [t for t in tasks if complete_shard(out, shard_path(t.split, t.number)) is None]
    if len(todo) < len(tasks):
        _log.info("%d of %d shards are there; going on with the rest", len(tasks) - len(todo), len(tasks))
    _render(config, out, todo, workers, progress or _ignore)
    records = [complete_shard(out, shard_path(t.split, t.number)) for t in tasks]
    assert None not in records
    finish_dataset(out, [r for r in records if r], _origin(config))
    return out


def fingerprint(config: DatasetConfig) -> str:
    """SHA-256 over everything that the bytes of the shards depend on."""
    values = config_to_dict(config)
    del values["scenes"]["baked"]  # says where scenes are read from, not what they are
    value = {
        "config": values,
        "generator": GENERATOR,
        "schema_version": SCHEMA_VERSION,
        "renderer": describe_renderer(config.render),
    }
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
    bake = [BakeTask(scene=s) for s in scenes_needed(config) if not scene_path(out, s).is_file()]
    done = config.frames - sum(task.stop - task.start for task in todo)

    def report(count: int) -> None:
        nonlocal done
        done += count
        progress(done, config.frames)

    progress(done, config.frames)
    num_workers = min(workers, max(len(todo), len(bake)))
    # All workers draw with what the fingerprint names.
    config = dataclasses.replace(config, render=resolve_backend(config.render))
    with WorkerPool(partial(RenderWorker, config, out), num_workers) as pool:
        pool.run(bake, _ignore)
        pool.run(todo, report)


def _origin(config: DatasetConfig) -> Origin:
    camera = Camera.on_robot(config.camera, (0.0, 0.0), 0.0)
    return Origin(
        generator=GENERATOR,
        fingerprint=fingerprint(config),
        renderer=describe_renderer(config.render),
        config=config_to_dict(config),
        camera=CameraRecord(
            height=camera.height,
            width=camera.width,
            K=camera.intrinsics.tolist(),
            depth_unit_m=1 / MILLIMETRES,
        ),
    )


def _ignore(*_: int) -> None:
    """Report to nobody."""
