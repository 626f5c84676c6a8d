"""Random generators that depend on names, not on the order in which work happens to be done.

Every piece of work derives its generator from the seed and from what it is (``"frames", "train",
17``), so the same seed gives the same bytes for any number of workers and any point of resumption.
"""

import hashlib

import numpy as np


def derive_seed(seed: int, *names: str | int) -> int:
    """A 128-bit seed for the piece of work called ``names`` under ``seed``."""
    text = "\x1f".join([str(seed), *(f"{type(n).__name__}:{n}" for n in names)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big")


def make_rng(seed: int, *names: str | int) -> np.random.Generator:
    """A NumPy generator for the piece of work called ``names`` under ``seed``."""
    return np.random.default_rng(derive_seed(seed, *names))
