"""Epochs of a dataset in a reproducible order, divided over readers, resumable at any sample."""

from collections.abc import Mapping
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from langwm_data.seeding import make_rng

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class SampleSource(Protocol[T_co]):
    """What a stream reads from."""

    def __len__(self) -> int: ...
    def __getitem__(self, which: int, /) -> T_co: ...


class SampleStream(Generic[T]):
    """An iterator over one part of each epoch.

    Iterating ends with the epoch; iterating again gives the next one. ``state_dict`` between any two
    samples and ``load_state_dict`` on an equal stream go on with the next sample.

    Args:
        samples: What to read.
        shuffle_seed: Draws a new order for each epoch; ``None`` keeps that of ``samples``.
        part: Which of ``num_parts`` disjoint parts to read, such as ``rank * num_workers + worker``.
        num_parts: In how many parts each epoch is divided; their sizes differ by at most one.

    Raises:
        ValueError: If ``part`` is not in ``range(num_parts)``.
    """

    def __init__(
        self, samples: SampleSource[T], *, shuffle_seed: int | None, part: int = 0, num_parts: int = 1
    ) -> None:
        if not 0 <= part < num_parts:
            raise ValueError(f"part is {part}; allowed with num_parts={num_parts}: 0 to {num_parts - 1}")
        self._samples = samples
        self._division = {
            "num_samples": len(samples),
            "shuffle_seed": shuffle_seed,
            "part": part,
            "num_parts": num_parts,
        }
        self._seek(epoch=0, position=0)

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T:
        if self._position == len(self._order):
            self._seek(epoch=self._epoch + 1, position=0)
            raise StopIteration
        self._position += 1
        return self._samples[int(self._order[self._position - 1])]

    def __len__(self) -> int:
        """Samples in one epoch of this part."""
        return len(self._order)

    def state_dict(self) -> dict[str, int | None]:
        """Where the stream stands and how it divides its samples: plain numbers, fit for JSON."""
        return {"epoch": self._epoch, "position": self._position, **self._division}

    def load_state_dict(self, state: Mapping[str, int | None]) -> None:
        """Go to where another stream over the same samples, seed and part stood.

        Raises:
            ValueError: If the other stream was divided otherwise, which would lose samples and repeat
                others, or the position lies outside the epoch.
        """
        for name, mine in self._division.items():
            if state.get(name) != mine:
                raise ValueError(f"the saved stream has {name} {state.get(name)}; this one has {mine}")
        epoch, position = state.get("epoch"), state.get("position")
        if epoch is None or epoch < 0 or position is None or not 0 <= position <= len(self):
            raise ValueError(
                f"stream position {position} in epoch {epoch} does not exist;"
                f" an epoch has {len(self)} samples"
            )
        self._seek(epoch=epoch, position=position)

    def _seek(self, *, epoch: int, position: int) -> None:
        seed, num_samples = self._division["shuffle_seed"], self._division["num_samples"]
        assert num_samples is not None
        order = np.arange(num_samples)
        if seed is not None:
            order = make_rng(seed, "epoch", epoch).permutation(order)
        self._order = order[self._division["part"] :: self._division["num_parts"]]
        self._epoch, self._position = epoch, position
