"""PyBullet, imported when first needed and without its chatter on the terminal."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from types import ModuleType


@contextmanager
def quiet() -> Iterator[None]:
    """Send what C code writes to standard output and error nowhere; Python's own output is flushed first."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 1)
        os.dup2(null, 2)
        yield
    finally:
        for number, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, number)
            os.close(copy)
        os.close(null)


def import_pybullet() -> ModuleType:
    """The ``pybullet`` module.

    Raises:
        ValueError: If it is not installed, which it cannot be on Python 3.12 and later.
    """
    if (module := sys.modules.get("pybullet")) is not None:
        return module
    try:
        with quiet():
            import pybullet
    except ImportError as error:
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise ValueError(
            f"this needs the package pybullet, which has wheels up to Python 3.11; this is Python {python}"
        ) from error
    return pybullet


def describe_physics() -> str:
    """What lets things come to rest on this machine: they lie alike where this is the same.

    Raises:
        ValueError: If it is not installed.
    """
    import_pybullet()
    return f"pybullet {version('pybullet')}"


@contextmanager
def connected() -> Iterator[int]:
    """A physics client, freed at the end."""
    client = connect()
    try:
        yield client
    finally:
        import_pybullet().disconnect(client)


def connect() -> int:
    """A new client without a window. It takes some 30 MiB until ``disconnect``."""
    bullet = import_pybullet()
    with quiet():
        return bullet.connect(bullet.DIRECT)
