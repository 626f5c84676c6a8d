"""Many environments at once, each in a process of its own that is started again when it breaks.

``gymnasium.make_vec`` makes vectors of ``LangWM/PointNav-v0`` in Gymnasium's own modes; there, a process that
dies takes the training with it. Here, its environment is made anew and led back to where it was: it is
deterministic, so the resets since the last seed and the actions of the running episode are all it takes.
"""

import faulthandler
import logging
import multiprocessing
import signal
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import CloudpickleWrapper, iterate

MakeEnv = Callable[[], gymnasium.Env]
Command = tuple[str, Any]

_JOIN_S = 5.0
_log = logging.getLogger(__name__)


class EnvCrashedError(RuntimeError):
    """An environment broke more often than it may be started again; ends with its process's traceback."""


class RestartingVectorEnv(SyncVectorEnv):
    """Environments in processes, stepped at the same time; spaces, infos and autoreset are Gymnasium's.

    Processes are spawned: a script needs the usual ``if __name__ == "__main__":``.

    Args:
        make_env: Makes one environment; called in each process. Must be deterministic given seed and actions.
        num_envs: How many.
        max_restarts: How often each of them may be started again within one episode.
        autoreset_mode: When the next episode begins; declared in ``metadata["autoreset_mode"]``.
    """

    def __init__(
        self,
        make_env: MakeEnv,
        num_envs: int,
        *,
        max_restarts: int = 2,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        if num_envs < 1 or max_restarts < 0:
            raise ValueError(
                f"num_envs {num_envs} and max_restarts {max_restarts} are not allowed;"
                " give 1 or more environments and 0 or more restarts"
            )
        self._remote = [RemoteEnv(make_env, number, max_restarts) for number in range(num_envs)]
        try:
            for env in self._remote:
                env.connect()
            super().__init__([lambda env=env: env for env in self._remote], autoreset_mode=autoreset_mode)
        except BaseException:
            self._close_remote()
            raise

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every environment, or in those of ``options["reset_mask"]``."""
        seeds: list[int | None] | None = (
            [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        )
        if "reset_mask" in (options or {}) or (seeds is not None and len(seeds) != self.num_envs):
            return super().reset(seed=seed, options=options)
        for env, own in zip(self._remote, seeds or [None] * self.num_envs, strict=True):
            env.ask_reset(own, options)
        return self._all_or_none(lambda: super(RestartingVectorEnv, self).reset(seed=seeds, options=options))

    def step(self, actions: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step every environment.

        Raises:
            EnvCrashedError: If one broke more often than it may.
        """
        is_reset = self._autoreset_envs & (self.autoreset_mode == AutoresetMode.NEXT_STEP)
        for env, action, begins in zip(
            self._remote, iterate(self.action_space, actions), is_reset, strict=True
        ):
            if begins:
                env.ask_reset(None, None)
            else:
                env.ask_step(action)
        return self._all_or_none(lambda: super(RestartingVectorEnv, self).step(actions))

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401
        """End the processes."""
        self._close_remote()

    def _all_or_none(self, call: Callable[[], Any]) -> Any:  # noqa: ANN401
        """Leave no answer behind for the next call when one environment fails."""
        try:
            return call()
        except BaseException:
            for env in self._remote:
                env.drain()
            raise

    def _close_remote(self) -> None:
        for env in self._remote:
            env.close()


class RemoteEnv(gymnasium.Env):
    """An environment in a process of its own.

    ``ask_reset`` and ``ask_step`` hand over work without waiting; the ``reset`` or ``step`` that follows
    takes the answer.

    Args:
        make_env: Makes it.
        number: Named in messages.
        max_restarts: How often it may be started again within one episode.
    """

    def __init__(self, make_env: MakeEnv, number: int, max_restarts: int) -> None:
        self._factory = CloudpickleWrapper(make_env)
        self._number = number
        self._max_restarts = max_restarts
        self._restarts = 0
        self._asked: Command | None = None
        self._resets: list[Command] = []
        self._steps: list[Command] = []
        self._is_closed = False
        self._start()

    def connect(self) -> None:
        """Wait until the environment is made, and learn what it looks like."""
        about: Mapping[str, Any] = self._answer(("describe", None))
        self.observation_space: spaces.Space = about["observation_space"]
        self.action_space: spaces.Space = about["action_space"]
        self.metadata: dict[str, Any] = about["metadata"]
        self.render_mode: str | None = about["render_mode"]

    def ask_reset(self, seed: int | None, options: Mapping[str, Any] | None) -> None:
        """Hand over a reset."""
        if seed is None and not self._resets:
            # Without a seed of its own nobody could lead it back.
            seed = int(np.random.default_rng().integers(2**31))
        self._ask(("reset", (seed, options)))

    def ask_step(self, action: np.ndarray) -> None:
        """Hand over a step."""
        self._ask(("step", np.array(action)))

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        if self._asked is None:
            self.ask_reset(seed, options)
        command, answer = self._take()
        self._note(command)
        return answer

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a step."""
        if self._asked is None:
            self.ask_step(action)
        command, answer = self._take()
        self._note(command)
        return answer

    def render(self) -> Any:  # noqa: ANN401
        """What the environment renders."""
        return self._answer(("render", None))

    def get_wrapper_attr(self, name: str) -> Any:  # noqa: ANN401
        """An attribute of this object, or else of the environment in the process; a copy then."""
        return getattr(self, name) if hasattr(self, name) else self._answer(("attribute", name))

    def drain(self) -> None:
        """Forget an answer that nobody will take; what was asked for has been done all the same."""
        if self._asked is not None:
            with suppress(Exception):
                self._note(self._take()[0])
            self._asked = None

    def close(self) -> None:
        """End the process; a second call does nothing."""
        if not self._is_closed:
            self._is_closed = True
            self._end(_JOIN_S)

    def _note(self, command: Command) -> None:
        """Remember what a new process has to do to stand where this one does."""
        kind, value = command
        if kind == "step":
            self._steps.append(command)
        if kind == "reset":
            if value[0] is not None:
                self._resets.clear()
            self._resets.append(command)
            self._steps.clear()
            self._restarts = 0

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, self._factory), name=f"env-{self._number}", daemon=True
        )
        self._process.start()
        theirs.close()

    def _end(self, patience_s: float) -> None:
        self._pipe.close()
        self._process.join(patience_s)
        self._process.kill()
        self._process.join()

    def _ask(self, command: Command) -> None:
        assert self._asked is None, "an answer was not taken"
        self._asked = command
        with suppress(OSError):  # A process that is gone is noticed when its answer is read.
            self._pipe.send(command)

    def _answer(self, command: Command) -> Any:  # noqa: ANN401
        self._ask(command)
        return self._take()[1]

    def _take(self) -> tuple[Command, Any]:
        """The command asked last and its answer, from a new process where the old one breaks."""
        command = self._asked
        assert command is not None, "nothing was asked"
        while True:
            try:
                answer = self._receive()
            except _BrokenError as error:
                self._restart(str(error))
                with suppress(OSError):
                    self._pipe.send(command)
            else:
                self._asked = None
                return command, answer

    def _receive(self) -> Any:  # noqa: ANN401
        try:
            kind, value = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join(_JOIN_S)
            raise _BrokenError(f"its process ended with exit code {self._process.exitcode}") from None
        if kind == "broken":
            raise _BrokenError(value)
        if kind == "refused":
            self._asked = None
            raise value
        return value

    def _restart(self, reason: str) -> None:
        """Make the environment anew and lead it back to where it was."""
        while True:
            if self._restarts >= self._max_restarts:
                self._asked = None
                raise EnvCrashedError(
                    f"environment {self._number} broke {self._restarts + 1} times in one episode;"
                    f" the last time: {reason}"
                )
            self._restarts += 1
            _log.warning("environment %d broke and is started again: %s", self._number, reason)
            self._end(0.0)
            self._start()
            try:
                for command in [*self._resets, *self._steps]:
                    self._pipe.send(command)
                    self._receive()
                return
            except _BrokenError as error:
                reason = str(error)
            except OSError:
                reason = "its process ended while it was led back"


class _BrokenError(Exception):
    """An environment that cannot go on."""


def _serve(pipe: Connection, factory: Callable[[], gymnasium.Env]) -> None:
    """Answer commands until the pipe closes."""
    # An interrupt from the keyboard reaches the whole group; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    faulthandler.enable()
    env: gymnasium.Env | None = None
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            command = pipe.recv()
            try:
                env = env or factory()
                pipe.send(("done", _do(env, command)))
            except (ValueError, gymnasium.error.Error) as error:
                # A request that is wrong: the environment stands as it did.
                error.add_note(f"in the process of an environment:\n{traceback.format_exc()}")
                pipe.send(("refused", error))
            except BrokenPipeError:
                raise
            except Exception:
                pipe.send(("broken", traceback.format_exc()))
    if env is not None:
        env.close()


def _do(env: gymnasium.Env, command: Command) -> Any:  # noqa: ANN401
    kind, value = command
    if kind == "describe":
        names = ("observation_space", "action_space", "metadata", "render_mode")
        return {name: getattr(env, name) for name in names}
    if kind == "reset":
        return env.reset(seed=value[0], options=value[1])
    if kind == "step":
        return env.step(value)
    return env.render() if kind == "render" else env.get_wrapper_attr(value)
