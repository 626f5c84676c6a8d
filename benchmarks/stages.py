"""Where time goes: seconds of each stage of a piece of work, such as making a shard in one worker.

Functions are replaced, where they are looked up, by ones that note when they begin and end. A stage's time
is its own: what another stage does in between is that stage's.
"""

import importlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

STAGES: dict[str, tuple[str, ...]] = {
    "choosing views": ("langwm_data.views:sample_yaw", "langwm_data.views:_sample_place"),
    "loading floors and palettes": ("langwm_data.frames:RenderWorker._show",),
    "drawing textures": ("langwm_data.sim.atlas:Atlas.place",),
    "rendering: culling": ("langwm_data.sim.scene_mesh:SceneMesh.visible_triangles",),
    "rendering: drawing and reading back": ("langwm_data.sim.render_gl:GlRenderer.render",),
    "rendering: smooth edges": (
        "langwm_data.sim.render_gl:find_open_quarters",
        "langwm_data.sim.render_gl:smooth_edges",
    ),
    "labels": ("langwm_data.frames:label_frame",),
    "shares hidden and cut off": ("langwm_data.frames:amodal_extents",),
    "encoding PNG": ("langwm_data.shards.sample:encode_png",),
    "JSON": ("langwm_data.shards.sample:json.dumps",),
    "tar, checksum, index, disk": ("langwm_data.frames:write_shard",),
    "the rest of a sample": ("langwm_data.frames:RenderWorker.make_sample",),
}
"""Stage to the functions that make it up, as ``module:name`` where they are looked up."""


class Clock:
    """Charges what passes to the stage that is being done.

    Args:
        read: What time it is: a number that only grows, or an array of such.
    """

    def __init__(self, read: Callable[[], Any] = time.process_time) -> None:
        self.seconds: defaultdict[str, Any] = defaultdict(float)
        self._read = read
        self._stage, self._since = "other", read()

    def enter(self, stage: str) -> str:
        """Charge what has passed, go on with ``stage``; the stage before."""
        now, before = self._read(), self._stage
        self.seconds[before] += now - self._since
        self._stage, self._since = stage, now
        return before

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function``, its time charged to ``stage``."""

        def wrapper(*args: Any, **kwargs: Any) -> Any:
            before = self.enter(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self.enter(before)

        return wrapper


@contextmanager
def stage_clock(
    stages: Mapping[str, tuple[str, ...]] = STAGES, read: Callable[[], Any] = time.process_time
) -> Iterator[Clock]:
    """A clock that runs while the block does; of this process's CPU time if ``read`` says nothing else."""
    clock, replaced = Clock(read), []
    for stage, places in stages.items():
        for place in places:
            owner, name = _resolve(place)
            function = getattr(owner, name)
            replaced.append((owner, name, function))
            setattr(owner, name, clock.timed(stage, function))
    try:
        yield clock
        clock.enter("other")
    finally:
        for owner, name, function in reversed(replaced):
            setattr(owner, name, function)


def _resolve(place: str) -> tuple[Any, str]:
    module, _, path = place.partition(":")
    owner: Any = importlib.import_module(module)
    *outer, name = path.split(".")
    for part in outer:
        owner = getattr(owner, part)
    return owner, name
