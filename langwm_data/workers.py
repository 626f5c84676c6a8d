"""A pool of processes that do tasks and report progress, or the same in this process.

Owns what may go wrong with processes: a worker that dies, an error in one, an interrupted or killed
parent, memory that grows. Workers end by themselves when the parent is gone, because their pipe to it
closes.
"""

import logging
import multiprocessing
import signal
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Self

Report = Callable[[int], None]
"""Called with the number of units of work just done."""
Worker = Callable[[Any, Report], None]
WorkerFactory = Callable[[], AbstractContextManager[Worker]]
"""Makes what does the tasks; called once in each process, so it has to be picklable."""
Lost = Callable[[Any, str], None]
"""Called with a task whose process died, and a sentence that says so."""

JOIN_S = 5.0
"""How long workers that are told to stop may take, if nothing else is said."""

_log = logging.getLogger(__name__)


class WorkerPool:
    """Processes that each hold one worker; with one worker everything happens in this process.

    Processes are spawned, not forked: scripts that use more than one need the usual
    ``if __name__ == "__main__":``.

    Args:
        make_worker: Makes what does the tasks.
        num_workers: How many at once.
        tasks_per_worker: After so many tasks a worker, and the process that holds it, gives way to a new
            one, so that memory that libraries do not give back stays bounded. Never where it is not given.
        is_separate: A single worker gets a process of its own as well.
        join_s: How many seconds workers may take to save what they have when they are told to stop.
    """

    def __init__(
        self,
        make_worker: WorkerFactory,
        num_workers: int,
        *,
        tasks_per_worker: int | None = None,
        is_separate: bool = False,
        join_s: float = JOIN_S,
    ) -> None:
        assert num_workers >= 1, num_workers
        assert tasks_per_worker is None or tasks_per_worker >= 1, tasks_per_worker
        self._make_worker = make_worker
        self._num_workers = num_workers
        self._is_local = num_workers == 1 and not is_separate
        self._join_s = join_s
        self._tasks_per_worker = tasks_per_worker
        self._pipes: dict[Connection, BaseProcess] = {}
        self._tasks_done: dict[Connection, int] = {}
        self._retired: list[BaseProcess] = []
        self._local: _LocalWorker | None = None

    def __enter__(self) -> Self:
        if self._is_local:
            self._local = _LocalWorker(self._make_worker, self._tasks_per_worker)
            return self
        for number in range(self._num_workers):
            self._start(f"worker-{number}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._local is not None:
            self._local.close()
        for pipe, process in self._pipes.items():
            if error is None:
                pipe.close()  # nothing more comes, so it ends
                continue
            process.terminate()
            with suppress(OSError):
                pipe.send(_NoMore())  # what saves and finishes in spite of it must not wait for another
        for process in [*self._retired, *self._pipes.values()]:
            process.join(self._join_s)
            process.kill()
        for pipe in self._pipes:  # only now: a worker that saves what it has may report until it is done
            pipe.close()

    def run(self, tasks: Sequence[Any], report: Report, lost: Lost | None = None) -> None:
        """Do all tasks; return when the last one is done.

        Args:
            tasks: What to do, in this order.
            report: Called with the units of work just done.
            lost: Called for a task whose process dies, upon which the others go on.

        Raises:
            ChildProcessError: If a worker process dies and ``lost`` is not given.
            Exception: What a task raised. Tasks that are done stay done.
        """
        if self._local is not None:
            for task in tasks:
                self._local.work(task, report)
            return
        waiting = list(reversed(tasks))
        busy: dict[Connection, Any] = {}
        for pipe in list(self._pipes):
            self._hand_out(pipe, waiting, busy)
        while busy:
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                try:
                    message = self._receive(pipe, busy[pipe])
                except ChildProcessError as death:
                    if lost is None:
                        raise
                    lost(busy.pop(pipe), str(death))
                    self._hand_out(self._replace(pipe), waiting, busy)
                    continue
                if isinstance(message, int):
                    report(message)
                    continue
                del busy[pipe]
                if message is not None:
                    raise message
                self._hand_out(pipe, waiting, busy)

    def _hand_out(self, pipe: Connection, waiting: list[Any], busy: dict[Connection, Any]) -> None:
        if not waiting:
            return
        if self._tasks_done[pipe] == self._tasks_per_worker:
            pipe = self._replace(pipe)
        self._tasks_done[pipe] += 1
        busy[pipe] = waiting.pop()
        with suppress(BrokenPipeError):  # A dead worker is noticed when its answer is read.
            pipe.send(busy[pipe])

    def _start(self, name: str) -> Connection:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self._make_worker), name=name, daemon=True)
        process.start()
        theirs.close()
        self._pipes[ours], self._tasks_done[ours] = process, 0
        return ours

    def _replace(self, pipe: Connection) -> Connection:
        """A new process for one that has done its share, which ends because its pipe closes."""
        process = self._pipes.pop(pipe)
        pipe.close()
        process.join(self._join_s)
        self._retired = [p for p in [*self._retired, process] if p.is_alive()]
        return self._start(process.name)

    def _receive(self, pipe: Connection, task: object) -> int | Exception | None:
        try:
            return pipe.recv()
        except (EOFError, ConnectionResetError):
            process = self._pipes[pipe]
            process.join(self._join_s)
            raise ChildProcessError(
                f"worker process {process.name} died ({_ending(process.exitcode)}) during {task};"
                " what was finished is kept, the same command goes on from there"
            ) from None


class _LocalWorker:
    """One worker in this process, made anew after its share of tasks."""

    def __init__(self, make_worker: WorkerFactory, tasks_per_worker: int | None) -> None:
        self._make_worker = make_worker
        self._tasks_per_worker = tasks_per_worker
        self._tasks_done = 0
        self._held = ExitStack()
        self._work = self._held.enter_context(make_worker())

    def work(self, task: object, report: Report) -> None:
        """Do one task."""
        if self._tasks_done == self._tasks_per_worker:
            self.close()
            self._work = self._held.enter_context(self._make_worker())
            self._tasks_done = 0
        self._tasks_done += 1
        self._work(task, report)

    def close(self) -> None:
        """Free what the worker holds."""
        self._held.close()


class _NoMore:
    """In the place of a task: there will be none."""


def _serve(pipe: Connection, make_worker: WorkerFactory) -> None:
    # An interrupt from the keyboard reaches the whole group; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError), make_worker() as work:
        while True:
            task = pipe.recv()
            if isinstance(task, _NoMore):
                return
            try:
                work(task, pipe.send)
            except BrokenPipeError:
                return
            except Exception as error:
                error.add_note(f"in a worker process:\n{traceback.format_exc()}")
                pipe.send(error)
            else:
                pipe.send(None)


def _leave(signum: int, _: object) -> None:
    raise SystemExit(128 + signum)


def _ending(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        return f"killed by {signal.Signals(-exitcode).name}"
    return f"exit code {exitcode}"
