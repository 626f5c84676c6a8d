"""A command of ours as a fork of this process, to be killed: PyTorch is imported once, not at every start.

Who forks has started no threads before: it sets PyTorch to one, imports what the command needs, and computes
nothing.
"""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import cli
from pretrain.metrics import read_metrics

_POLL_S = 0.01


@dataclass(frozen=True, kw_only=True)
class Command:
    """One call of ``langwm``, but for where it writes; what it says goes to a log beside that folder."""

    arguments: tuple[str, ...]
    """The command's name, then its flags."""

    def start(self, out: Path) -> int:
        """Begin it, or go on with it, in a process group of its own; its id."""
        pid = os.fork()
        if pid:
            return pid
        os.setsid()
        with self._log_of(out).open("a") as log:
            for stream in (1, 2):
                os.dup2(log.fileno(), stream)
            os._exit(cli.run([*self.arguments, "--out", str(out)]))

    def finish(self, out: Path) -> None:
        """Begin it, or go on with it, and wait for its end.

        Raises:
            SystemExit: If it fails.
        """
        _, status = os.waitpid(self.start(out), 0)
        if code := os.waitstatus_to_exitcode(status):
            raise SystemExit(f"{self.arguments[0]} failed with {code}; see {self._log_of(out)}")

    def kill_at(self, out: Path, step: int, delay_s: float) -> int:
        """Go on until ``step`` has been logged and a moment longer, then kill; the last step that was logged.

        Raises:
            SystemExit: If it ends before ``step``.
        """
        pid = self.start(out)
        while last_step(out) < step:
            if os.waitpid(pid, os.WNOHANG)[0]:
                raise SystemExit(f"{self.arguments[0]} ended before step {step}; see {self._log_of(out)}")
            time.sleep(_POLL_S)
        time.sleep(delay_s)
        os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        return last_step(out)

    @staticmethod
    def _log_of(out: Path) -> Path:
        return out.with_name(f"{out.name}.log")


def last_step(out: Path) -> int:
    """Of the log; what a run that goes on takes back still counts until it does."""
    rows = read_metrics(out)
    return rows[-1]["step"] if rows else 0


def learned(out: Path, *, except_for: str) -> list[dict[str, float]]:
    """The log without the numbers that depend on the machine, whose names begin with ``except_for``."""
    return [{k: v for k, v in row.items() if not k.startswith(except_for)} for row in read_metrics(out)]
