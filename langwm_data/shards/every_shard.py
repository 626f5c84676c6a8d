"""Have processes look at every shard of a dataset, and collect what they say in the shards' order."""

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from langwm_data import atomic
from langwm_data.shards.index_check import Span
from langwm_data.shards.manifest import ShardRecord
from langwm_data.workers import Report, WorkerPool


@dataclass(frozen=True, kw_only=True)
class ShardCheck:
    """Look at one shard, and at its rows of the index where there are rows to compare with."""

    number: int
    record: ShardRecord
    frames: Span | None = None
    objects: Span | None = None


Check = Callable[[ShardCheck, Report], Any]
"""Looks at one shard and answers in JSON; gets shards in ascending order and reports every frame."""


def check_every_shard(
    make_check: Callable[[], Check],
    tasks: Sequence[ShardCheck],
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> list[Any]:
    """The answers, in the order of the tasks. They travel through files, so that memory stays flat.

    Raises:
        ChildProcessError: If a worker process is killed.
    """
    done, total = 0, sum(task.record.samples for task in tasks)

    def report(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, total)

    with tempfile.TemporaryDirectory(prefix="langwm-verify-") as folder:
        answers = Path(folder)
        with WorkerPool(partial(_Answerer, make_check, answers), max(1, min(workers, len(tasks)))) as pool:
            pool.run(tasks, report)
        return [json.loads(_answer_file(answers, task).read_text("utf-8")) for task in tasks]


class _Answerer:
    """Does checks in a worker process and writes down the answers."""

    def __init__(self, make_check: Callable[[], Check], answers: Path) -> None:
        self._check = make_check()
        self._answers = answers

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is held."""

    def __call__(self, task: ShardCheck, report: Report) -> None:
        atomic.write_json(_answer_file(self._answers, task), self._check(task, report), indent=None)


def _answer_file(answers: Path, task: ShardCheck) -> Path:
    return answers / f"{task.number}.json"
