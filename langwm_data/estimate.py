"""What rendering a dataset will take, from a few frames that are rendered and thrown away."""

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig
from langwm_data.frames import BakeTask, RenderWorker
from langwm_data.plan import FramePlan, ShardTask, plan_frame, plan_shards, scenes_of, tasks_in_range
from langwm_data.shards.sample import Sample
from langwm_data.shards.scenes import scene_path
from langwm_data.shards.summary import format_size
from langwm_data.shards.writer import part_files, write_shard

_SAMPLE_FRAMES = 16
_FLOOR_BYTES = 10_000_000
"""A worker holds every floor that it has shown. Source: ours, 8.4 MB each measured over 13 floors."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What the shards asked for will take, if every worker has a core of its own."""

    frames: int
    shards: int
    floors: int
    workers: int
    sample_frames: int
    bytes_per_frame: float
    bytes_per_floor: float
    seconds_per_frame: float
    seconds_per_floor: float
    """To build it and let loose things come to rest, done once."""
    worker_bytes: int
    """Memory of one worker at its largest."""

    @property
    def disk_bytes(self) -> float:
        """Of the finished dataset."""
        return self.frames * self.bytes_per_frame + self.floors * self.bytes_per_floor

    @property
    def memory_bytes(self) -> int:
        """Of all workers."""
        return self.workers * self.worker_bytes

    @property
    def hours(self) -> float:
        """Until the last shard is there."""
        work_s = self.frames * self.seconds_per_frame + self.floors * self.seconds_per_floor
        return work_s / self.workers / 3600

    def as_text(self) -> str:
        """One line each for frames, disk, memory and time."""
        return "\n".join(
            (
                f"frames  {self.frames:,} in {self.shards:,} shards, of {self.floors} floors",
                f"disk    {format_size(self.disk_bytes)}, {format_size(self.bytes_per_frame)} a frame",
                f"memory  {format_size(self.memory_bytes)}, {format_size(self.worker_bytes)} a worker",
                f"time    {_duration(self.hours)} with {self.workers} worker{'s' * (self.workers > 1)} of a"
                f" core each: {self.seconds_per_frame * 1e3:.3g} ms a frame,"
                f" {self.seconds_per_floor:.2g} s a floor",
                f"measured on {self.sample_frames} frames, which are thrown away",
            )
        )


def estimate(config: DatasetConfig, *, workers: int = 1, shards: range | None = None) -> Estimate:
    """Render a few frames in a temporary folder and say what all of them will take.

    Args:
        config: What to render.
        workers: Processes that will render it.
        shards: Which shards; all if not given.

    Raises:
        ConfigError: If ``config`` cannot be rendered, or has no such shards.
    """
    open_scenes(config.scenes, config.splits.holds_out).check_whole()
    tasks = plan_shards(config) if shards is None else tasks_in_range(config, shards)
    floors = scenes_of(config, tasks)
    plans = _sample_plans(config, tasks[0])
    shown = list(dict.fromkeys(plan.scene for plan in plans))
    physics = open_scenes(config.scenes, config.splits.holds_out).physics
    bake = [BakeTask(scene=scene, physics=physics) for scene in shown]
    with (
        tempfile.TemporaryDirectory(prefix="langwm-plan-") as name,
        RenderWorker(config, Path(name)) as worker,
    ):
        folder = Path(name)
        floor_s = _seconds(lambda: [worker(task, lambda _: None) for task in bake])
        first: list[Sample] = []
        floor_s += _seconds(lambda: first.extend(worker.make_sample(p) for p in _first_of_each(plans)))
        samples = (worker.make_sample(plan) for plan in plans)
        frame_s = _seconds(lambda: write_shard(folder, tasks[0].split, 0, samples))
        record = next(folder.glob("*/*.tar"))
        written = [record, *(folder / part for part in part_files(str(record.relative_to(folder))))]
        floor_bytes = sum(scene_path(folder, scene).stat().st_size for scene in shown) / len(shown)
        frame_bytes = sum(path.stat().st_size for path in written) / len(plans)
    return Estimate(
        frames=sum(task.stop - task.start for task in tasks),
        shards=len(tasks),
        floors=len(floors),
        workers=workers,
        sample_frames=len(plans),
        bytes_per_frame=frame_bytes,
        bytes_per_floor=floor_bytes,
        seconds_per_frame=frame_s / len(plans),
        seconds_per_floor=floor_s / len(shown),
        worker_bytes=_peak_bytes() + _FLOOR_BYTES * (len(floors) - len(shown)),
    )


def _sample_plans(config: DatasetConfig, task: ShardTask) -> list[FramePlan]:
    """The first frames of a shard, of one floor or two."""
    stop = min(task.stop, task.start + _SAMPLE_FRAMES)
    plans = [plan_frame(config, task.split, number) for number in range(task.start, stop)]
    shown = list(dict.fromkeys(plan.scene for plan in plans))[:2]
    return [plan for plan in plans if plan.scene in shown]


def _first_of_each(plans: list[FramePlan]) -> list[FramePlan]:
    return list({plan.scene: plan for plan in reversed(plans)}.values())


def _duration(hours: float) -> str:
    if hours * 3600 < 100:
        return f"{hours * 3600:.2g} seconds"
    return f"{hours * 60:.0f} minutes" if hours * 60 < 100 else f"{hours:,.3g} hours"


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
