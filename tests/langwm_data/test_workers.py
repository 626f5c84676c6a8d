import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from langwm_data.workers import WorkerPool


class Squarer:
    """A worker for tests; tasks are numbers to square, or words that make it fail."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __call__(self, task, report):
        if task == "full disk":
            raise OSError(errno.ENOSPC, "No space left on device", "shard.tar")
        if task == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        report(task * task)


@pytest.mark.parametrize("num_workers", [1, 2])
def test_all_tasks_are_done_and_reported(num_workers):
    reported = []
    with WorkerPool(Squarer, num_workers) as pool:
        pool.run(range(6), reported.append)
        assert sorted(reported) == [0, 1, 4, 9, 16, 25]
        pool.run([], reported.append)
        pool.run([7], reported.append)
    assert reported[-1] == 49


@pytest.mark.parametrize("num_workers", [1, 2])
def test_errors_arrive_as_they_were_raised(num_workers):
    with (
        pytest.raises(OSError, match="No space left on device") as caught,
        WorkerPool(Squarer, num_workers) as pool,
    ):
        pool.run([1, "full disk", 2], int)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, "shard.tar")


def test_a_killed_worker_is_reported():
    message = "worker process worker-0 died .killed by SIGKILL. during die; what was finished is kept"
    with pytest.raises(ChildProcessError, match=message), WorkerPool(Squarer, 2) as pool:
        pool.run(["die"], int)


@pytest.mark.parametrize("num_workers", [1, 2])
def test_where_somebody_hears_of_lost_tasks_the_others_go_on(num_workers):
    reported, lost = [], []
    with WorkerPool(Squarer, num_workers, is_separate=True) as pool:
        pool.run([1, "die", 2, "die", 3], reported.append, lambda *a: lost.append(a))
        pool.run([4], reported.append)
    assert sorted(reported) == [1, 4, 9, 16]
    assert [task for task, _ in lost] == ["die", "die"]
    assert all("killed by SIGKILL" in sentence for _, sentence in lost)


def test_a_single_worker_may_have_a_process_of_its_own():
    reported = []
    with WorkerPool(Counter, 1, is_separate=True) as pool:
        pool.run([1], reported.append)
    assert reported[0] // 100 != os.getpid()


class Saver:
    """A worker that, told to stop, reports once more and then saves; the task is where."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __call__(self, task, report):
        asked = []
        signal.signal(signal.SIGTERM, lambda *_: asked.append(True))
        while not asked:
            time.sleep(0.01)
            report(0)
        report(1)
        task.write_text("saved")


def test_workers_that_are_told_to_stop_may_save_what_they_have(tmp_path):
    def interrupt(count):
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), WorkerPool(Saver, 1, is_separate=True, join_s=300) as pool:
        pool.run([tmp_path / "state"], interrupt)
    assert (tmp_path / "state").read_text() == "saved"
    assert time.monotonic() - start < 200, "it ends as soon as it has saved, and is not waited for in vain"


class Counter:
    """A worker that reports which process it is in, and how many tasks it has done itself."""

    def __enter__(self):
        self.done = 0
        return self

    def __exit__(self, *_):
        pass

    def __call__(self, task, report):
        self.done += 1
        report(os.getpid() * 100 + self.done)


@pytest.mark.parametrize("num_workers", [1, 2])
def test_a_worker_gives_way_to_a_new_one_after_its_share_of_tasks(num_workers):
    reported = []
    with WorkerPool(Counter, num_workers, tasks_per_worker=2) as pool:
        pool.run(range(3), reported.append)
        pool.run(range(4), reported.append)
    assert len(reported) == 7
    assert {value % 100 for value in reported} == {1, 2}
    pids = {value // 100 for value in reported}
    assert pids == {os.getpid()} if num_workers == 1 else len(pids) >= 4
    assert not any(is_running(pid) for pid in pids - {os.getpid()})


def test_without_a_share_a_worker_stays():
    reported = []
    with WorkerPool(Counter, 1) as pool:
        pool.run(range(5), reported.append)
    assert [value % 100 for value in reported] == [1, 2, 3, 4, 5]


ORPHANS = """
import os, signal, sys, time
from langwm_data.workers import WorkerPool

class Sleeper:
    def __enter__(self): return self
    def __exit__(self, *_): pass
    def __call__(self, task, report):
        os.write(1, f"{os.getpid()}\\n".encode())  # one write, so that two workers' lines never mix
        while True:
            time.sleep(0.05)
            report(0)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background inherit "ignore"
    with WorkerPool(Sleeper, 2) as pool:
        pool.run([1, 2], int)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_their_parent(number, tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    with subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
    ) as parent:
        try:
            pids = [int(parent.stdout.readline()) for _ in range(2)]
            parent.send_signal(number)
            parent.wait(30)
        finally:
            parent.kill()
    deadline = time.monotonic() + 10
    while any(is_running(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(is_running(pid) for pid in pids)


def is_running(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
