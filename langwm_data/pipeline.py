"""Render a dataset: plan, workers, shards, index, manifest. Safe to stop and start again anywhere.

Owns the order of things, and what a range of shards may do beside other ranges: it makes its own shards,
discards nothing, and completes the dataset if it finds all others made.
"""

import dataclasses
import logging
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from langwm_data import atomic
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, config_to_dict
from langwm_data.engines import Engine, Pool, check_engine, make_pool
from langwm_data.fingerprint import fingerprint_of
from langwm_data.frames import BakeTask
from langwm_data.output import FINGERPRINT_FILE, Output, open_output
from langwm_data.plan import SPLITS, ShardTask, plan_shards, scenes_of, tasks_in_range
from langwm_data.shards.finish import Origin
from langwm_data.shards.manifest import GENERATOR, SCHEMA_VERSION, CameraRecord, Manifest
from langwm_data.shards.sample import MILLIMETRES
from langwm_data.shards.scenes import SCENES_DIR, scene_path
from langwm_data.shards.writer import shard_path
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import describe_renderer, resolve_backend
from langwm_data.workers import WorkerFactory

Progress = Callable[[int, int], None]
"""Called with frames done and frames in all."""
OutT = TypeVar("OutT", Path, str)
_MakePool = Callable[[WorkerFactory, int], Pool]

_log = logging.getLogger(__name__)


def render_dataset(
    config: DatasetConfig,
    out: OutT,
    *,
    workers: int | None = None,
    engine: Engine = "local",
    fresh: bool = False,
    progress: Progress | None = None,
) -> OutT:
    """Render the dataset that ``config`` describes into ``out``.

    Same config, same bytes in every shard, for any engine and number of workers. When a dataset was begun
    in ``out``, complete shards are kept and the rest is made; when it is finished, nothing is done.

    Args:
        config: What to render.
        out: Folder of the dataset, made if missing, or a URL that fsspec can write.
        workers: Processes, one if not given. More need a script guarded by
            ``if __name__ == "__main__":``.
        engine: ``local``: processes of this machine; ``ray``: a Ray cluster, all of it.
        fresh: Throw away what is in ``out`` and start over.
        progress: Called with frames done and frames in all.

    Returns:
        ``out``.

    Raises:
        ConfigError: If ``out`` holds something else, or ``config`` cannot be rendered.
        OSError: If the disk is full or cannot be written; complete shards are kept.
        ChildProcessError: If a worker process is killed; complete shards are kept.
    """
    check_engine(engine, workers)
    open_scenes(config.scenes, config.splits.holds_out).check_whole()
    mark = fingerprint(config)  # refuses a renderer that does not open, before anything is written
    with open_output(out, fresh=fresh) as output:
        output.claim(config, fresh=fresh)
        if not _is_finished(output):
            _discard_other_work(output, mark)
            pool_of = partial(make_pool, engine, workers)
            is_complete = _make(config, output, plan_shards(config), pool_of, progress or _ignore)
            assert is_complete, out
    return out


def render_range(
    config: DatasetConfig,
    out: Path | str,
    shards: range,
    *,
    workers: int | None = None,
    engine: Engine = "local",
    progress: Progress | None = None,
) -> bool:
    """Render some shards of the dataset that ``config`` describes; other ranges may run at the same time.

    The range that finds all others made completes index and manifest; should none of several that end at
    once see it on a slow shared folder, ``render_dataset`` does.

    Args:
        config: What to render.
        out: As for ``render_dataset``; the same for all ranges.
        shards: Which ones, counted over training and then test shards; what lies past the last one is
            left out.
        workers: As for ``render_dataset``.
        engine: As for ``render_dataset``.
        progress: Called with frames done and frames of this range.

    Returns:
        Whether the dataset is complete.

    Raises:
        ConfigError: Also if there are no such shards, or ``out`` holds work of another version or renderer.
        OSError: As ``render_dataset``.
        ChildProcessError: As ``render_dataset``.
    """
    check_engine(engine, workers)
    open_scenes(config.scenes, config.splits.holds_out).check_whole()
    tasks = tasks_in_range(config, shards)
    mark = fingerprint(config)
    with open_output(out, fresh=False) as output:
        output.claim(config, fresh=False)
        if _is_finished(output):
            return True
        _join_work(output, mark, str(out))
        return _make(config, output, tasks, partial(make_pool, engine, workers), progress or _ignore)


def fingerprint(config: DatasetConfig, made: Manifest | None = None) -> str:
    """The checksum of what the bytes of the shards depend on.

    Args:
        config: What is rendered.
        made: A dataset whose scenes are there: what they were made of and by is read off its manifest, and
            needs not be on this machine. Without it, they are made here, or read as ``scenes.baked`` says.

    Raises:
        ValueError: If the scenes or the renderer cannot be had on this machine.
    """
    if made is None:
        library = open_scenes(config.scenes, config.splits.holds_out)
        sources, physics = library.identity, library.physics
    else:
        sources, physics = made.sources, made.physics
    return fingerprint_of(
        config_to_dict(config),
        sources=sources,
        physics=physics,
        renderer=describe_renderer(config.render),
        generator=GENERATOR,
        schema_version=SCHEMA_VERSION,
    )


def _is_finished(output: Output) -> bool:
    if not output.is_finished():
        return False
    _log.info("the dataset is complete; nothing to do")
    output.remove_leftovers()  # of a job that was killed just before its end, or overtaken
    return True


def _discard_other_work(output: Output, mark: str) -> None:
    """Keep unfinished work only if this very program began it."""
    path = output.folder / FINGERPRINT_FILE
    if not path.is_file() or path.read_text("utf-8") != mark:
        output.discard_work()
        atomic.write_text(path, mark)
    output.announce()


def _join_work(output: Output, mark: str, out: str) -> None:
    """Go on with unfinished work only if this very program began it; discard nothing.

    A range writes the fingerprint before anything else; so who looks in the other order never takes work
    of a range that has just begun for that of somebody else.
    """
    is_begun = any((output.folder / name).exists() for name in (SCENES_DIR, *SPLITS))
    path = output.folder / FINGERPRINT_FILE
    begun_by = path.read_text("utf-8") if path.is_file() else None
    if begun_by != mark and (is_begun or begun_by is not None):
        raise ConfigError(
            f"--out {out!r} holds work of another version or renderer, which --shards does not discard;"
            " use another folder, or start over with --fresh and without --shards"
        )
    if begun_by is None:
        atomic.write_text(path, mark)
    output.announce()


def _make(
    config: DatasetConfig, output: Output, tasks: Sequence[ShardTask], pool_of: _MakePool, progress: Progress
) -> bool:
    """Make these shards, and the dataset if they were the last; whether it is complete."""
    try:
        _render(config, output, tasks, pool_of, progress)
        return _finish_if_last(config, output)
    except FileNotFoundError:
        # Another job that made these shards as well has finished, and cleared the work away.
        if not _is_finished(output):
            raise
        return True


def _render(
    config: DatasetConfig, output: Output, tasks: Sequence[ShardTask], pool_of: _MakePool, progress: Progress
) -> None:
    """Bake the floors that are missing, then make the shards that are."""
    there = {record.path for record in output.complete_shards(tasks, check_bytes=True)}
    todo = [task for task in tasks if shard_path(task.split, task.number) not in there]
    if not todo:
        return
    if there:
        _log.info("%d of %d shards are there; going on with the rest", len(there), len(tasks))
    floors = [s for s in scenes_of(config, tasks) if not scene_path(output.folder, s).is_file()]
    bake = [
        BakeTask(scene=name, physics=open_scenes(config.scenes, config.splits.holds_out).physics)
        for name in floors
    ]
    total = sum(task.stop - task.start for task in tasks)
    done = total - sum(task.stop - task.start for task in todo)

    def report(count: int) -> None:
        nonlocal done
        done += count
        progress(done, total)

    progress(done, total)
    # All workers draw with what the fingerprint names.
    config = dataclasses.replace(config, render=resolve_backend(config.render))
    with pool_of(output.worker_factory(config), max(len(todo), len(bake))) as pool:
        pool.run(bake, _ignore)
        pool.run(todo, report)


def _finish_if_last(config: DatasetConfig, output: Output) -> bool:
    tasks = plan_shards(config)
    records = output.complete_shards(tasks, check_bytes=False)
    if len(records) == len(tasks):
        output.finish(records, _origin(config))
        return True
    if _is_finished(output):
        return True
    _log.info("%d of %d shards are there; other ranges make the rest", len(records), len(tasks))
    return False


def _origin(config: DatasetConfig) -> Origin:
    camera, library = (
        Camera.on_robot(config.camera, (0.0, 0.0), 0.0),
        open_scenes(config.scenes, config.splits.holds_out),
    )
    return Origin(
        generator=GENERATOR,
        fingerprint=fingerprint(config),
        renderer=describe_renderer(config.render),
        config=config_to_dict(config),
        sources=dict(library.identity),
        physics=library.physics,
        camera=CameraRecord(
            height=camera.height,
            width=camera.width,
            K=camera.intrinsics.tolist(),
            depth_unit_m=1 / MILLIMETRES,
        ),
    )


def _ignore(*_: Any) -> None:  # noqa: ANN401
    """Report to nobody."""
