"""Processes that train one model together: who is who, and what they add up.

``torchrun`` or ``accelerate launch`` starts them; alone, a process is a team of one and nothing here costs
anything. Each member works on its own rows of every batch. What is summed is divided by counts over all
members, so that a team learns what one process with the whole batch would, up to rounding.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, distributed

from langwm_data.config_io import ConfigError


@dataclass(frozen=True, kw_only=True)
class Team:
    """All members, seen from one of them."""

    rank: int = 0
    """Of this member, from 0."""
    size: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this member writes what all share."""
        return self.rank == 0

    def rows(self, num_rows: int) -> range:
        """This member's part of a batch that all share."""
        share = num_rows // self.size
        return range(self.rank * share, (self.rank + 1) * share)

    def add(self, values: Tensor) -> Tensor:
        """The sum of everybody's ``values``, in place."""
        if self.size > 1:
            distributed.all_reduce(values)
        return values

    def add_gradients(self, parameters: Sequence[Tensor]) -> None:
        """Give everybody the sum of the gradients of all."""
        if self.size == 1:
            return
        gradients = [p.grad for p in parameters if p.grad is not None]
        flat = self.add(torch.cat([g.flatten() for g in gradients]))
        for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))

    def any(self, is_so: bool, device: torch.device) -> bool:
        """Whether it is so for any member."""
        return is_so if self.size == 1 else bool(self.add(torch.tensor(float(is_so), device=device)) > 0)

    def wait(self) -> None:
        """Until all are here."""
        if self.size > 1:
            distributed.barrier()


ALONE = Team()


@contextmanager
def joined_team() -> Iterator[Team]:
    """The team that this process was started in, for as long as it takes part."""
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        yield ALONE
        return
    distributed.init_process_group()
    try:
        yield Team(rank=distributed.get_rank(), size=size)
    finally:
        distributed.destroy_process_group()


def own_device(name: str) -> str:
    """The device called ``name`` for this process: on a machine with several of a kind, each has one."""
    local = os.environ.get("LOCAL_RANK")
    return name if local is None or ":" in name or name == "cpu" else f"{name}:{local}"


def check_shares(batch_size: int, parts: int, team: Team) -> None:
    """Refuse a batch that cannot be shared out evenly.

    Raises:
        ConfigError: If some member or some part of a step would have more frames than another.
    """
    if batch_size % (parts * team.size):
        raise ConfigError(
            f"batch_size {batch_size} must be a multiple of {parts * team.size}: optimizer.accumulate"
            f" {parts} parts times {team.size} processes"
        )
