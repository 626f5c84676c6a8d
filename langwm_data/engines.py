"""Who does the tasks: processes of this machine, or a Ray cluster.

Owns the choice and what it needs. An engine decides when and where a task is done, never what comes out:
every task depends on the config and its own description alone.
"""

import importlib
import logging
import pickle
from collections.abc import Sequence
from functools import lru_cache
from types import TracebackType
from typing import Any, Literal, Protocol, Self, runtime_checkable

from langwm_data.config_io import ConfigError
from langwm_data.workers import Lost, Report, Worker, WorkerFactory, WorkerPool

Engine = Literal["local", "ray"]

TASKS_PER_WORKER = 32
"""Shards that one process makes before a new one takes its place."""
RAY_RETRIES = 3
"""How often a task is started again when the process or node that did it is lost."""


@runtime_checkable
class Pool(Protocol):
    """Does tasks while it is open."""

    def __enter__(self) -> Self:
        """Start."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop, also what is still being done."""
        ...

    def run(self, tasks: Sequence[Any], report: Report, lost: Lost | None = None) -> None:
        """Do all tasks; return when the last one is done. ``lost`` hears of those whose process died."""
        ...


def check_engine(engine: str, workers: int | None) -> Engine:
    """The engine of that name.

    Raises:
        ConfigError: If it is unknown or not installed, or does not take so many workers.
    """
    if engine != "local" and engine != "ray":
        raise ConfigError(f"--engine {engine!r} is unknown; allowed: local, ray")
    if workers is not None and workers < 1:
        raise ConfigError(f"--workers {workers} is not allowed; allowed: 1 or more")
    if engine == "local":
        return engine
    if workers is not None:
        raise ConfigError(f"--workers {workers} is for --engine local; ray uses every core of its cluster")
    try:
        _ray()
    except ImportError as error:
        raise ConfigError("--engine ray needs the package ray: pip install 'langwm[ray]'") from error
    return engine


def make_pool(engine: str, workers: int | None, make_worker: WorkerFactory, num_tasks: int) -> Pool:
    """A pool for at most ``num_tasks`` tasks at once."""
    if engine == "ray":
        return RayPool(make_worker, tasks_per_worker=TASKS_PER_WORKER)
    return WorkerPool(make_worker, min(workers or 1, num_tasks), tasks_per_worker=TASKS_PER_WORKER)


class RayPool:
    """One Ray task for each task, each on one core; a task whose process or node is lost is done again.

    Joins the cluster that Ray finds (a session that is open, ``RAY_ADDRESS``, or one started on this
    machine), else starts one on this machine. Every node needs this program, and the output: a folder that
    all share, or a URL.

    Args:
        make_worker: Makes what does the tasks.
        tasks_per_worker: After so many tasks a process gives way to a new one.
        num_gpus: That each task needs to itself.
    """

    def __init__(self, make_worker: WorkerFactory, *, tasks_per_worker: int, num_gpus: int = 0) -> None:
        self._factory = pickle.dumps(make_worker)
        self._tasks_per_worker = tasks_per_worker
        self._num_gpus = num_gpus
        self._pending: dict[Any, Any] = {}

    def __enter__(self) -> Self:
        ray = _ray()
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            try:
                ray.init(logging_level=logging.WARNING)
            except Exception as error:  # Ray raises nothing narrower
                raise ConnectionError(f"Ray does not start, or cannot be joined: {error}") from error
        needs = {"num_cpus": 1, "num_gpus": self._num_gpus}
        options = {"max_retries": RAY_RETRIES, "max_calls": self._tasks_per_worker}
        self._remote = ray.remote(**needs, **options)(_do_task)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        ray = _ray()
        for reference in self._pending:
            ray.cancel(reference, force=True)
        if self._is_ours:
            ray.shutdown()

    def run(self, tasks: Sequence[Any], report: Report, lost: Lost | None = None) -> None:
        """Do all tasks; return when the last one is done. Each is reported when it is done.

        Args:
            tasks: What to do.
            report: Called with the units of work of a task that is done.
            lost: Called for a task that is lost too often, upon which the others go on.

        Raises:
            ChildProcessError: If a task is lost more often than it is started again, and ``lost`` is not
                given.
            Exception: What a task raised. Tasks that are done stay done.
        """
        ray = _ray()
        self._pending = {self._remote.remote(self._factory, task): task for task in tasks}
        while self._pending:
            for reference in ray.wait(list(self._pending))[0]:
                task = self._pending.pop(reference)
                try:
                    report(ray.get(reference))
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from None
                except ray.exceptions.RayError as error:
                    sentence = (
                        f"the Ray cluster lost {task} {RAY_RETRIES + 1} times ({type(error).__name__});"
                        " what was finished is kept, the same command goes on from there"
                    )
                    if lost is None:
                        raise ChildProcessError(sentence) from None
                    lost(task, sentence)


def _ray() -> Any:  # noqa: ANN401
    """The package, which only this engine needs."""
    return importlib.import_module("ray")


def _do_task(factory: bytes, task: object) -> int:
    """Do one task in a process of the cluster; the units of work done."""
    counts: list[int] = []
    _worker(factory)(task, counts.append)
    return sum(counts)


@lru_cache(maxsize=1)
def _worker(factory: bytes) -> Worker:
    """The worker of this process, which is held until the process ends. ``factory`` comes from the driver."""
    return pickle.loads(factory)().__enter__()
