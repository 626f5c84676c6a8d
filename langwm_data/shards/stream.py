"""Epochs of a dataset in a reproducible order, divided over readers, resumable at any sample."""

from collections.abc import Mapping
from typing import Protocol, Self

import numpy as np

from langwm_data.seeding import make_rng
from langwm_data.shards.sample import Sample


class SampleSource(Protocol):
    """What a stream reads from."""

    def __len__(self) -> int: ...
    def __getitem__(self, which: int, /) -> Sample: ...


class SampleStream:
    """An iterator over one part of each epoch.

    Iterating ends with the epoch; iterating again gives the next one. ``state`` between any two samples
    and ``restore`` on an equal stream go on with the next sample.
    """

    def __init__(
        self,
        samples: SampleSource,
        *,
        shuffle_seed: int | None,
        part: int,
        num_parts: int,
    ) -> None:
        if not 0 <= part < num_parts:
            raise ValueError(f"part is {part}; allowed with num_parts={num_parts}: 0 to {num_parts - 1}")
        self._samples = samples
        self._shuffle_seed = shuffle_seed
        self._part, self._num_parts = part, num_parts
        self._epoch = 0
        self._position = 0
        self._order = self._draw_order()

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Sample:
        if self._position == len(self._order):
            self._epoch += 1
            self._position = 0
            self._order = self._draw_order()
            raise StopIteration
        self._position += 1
        return self._samples[int(self._order[self._position - 1])]

    def __len__(self) -> int:
        """Samples in one epoch of this part."""
        return len(self._order)

    def state(self) -> dict[str, int]:
        """Where the stream stands: plain numbers, fit for JSON."""
        return {"epoch": self._epoch, "position": self._position}

    def restore(self, state: Mapping[str, int]) -> None:
        """Go to where another stream over the same samples, seed and part stood.

        Raises:
            ValueError: If the position lies outside the epoch.
        """
        epoch, position = int(state["epoch"]), int(state["position"])
        if epoch < 0 or not 0 <= position <= len(self._order):
            raise ValueError(
                f"stream position {position} in epoch {epoch} does not exist;"
                f" an epoch has {len(self)} samples"
            )
        self._epoch, self._position = epoch, position
        self._order = self._draw_order()

    def _draw_order(self) -> np.ndarray:
        order = np.arange(len(self._samples))
        if self._shuffle_seed is not None:
            order = make_rng(self._shuffle_seed, "epoch", self._epoch).permutation(order)
        return order[self._part :: self._num_parts]
