"""Large batches on a CPU, a part at a time.

What lies between two layers of a large batch is larger than the allocator keeps: it is mapped, cleared and
given back at every operation, which takes as long as the arithmetic. Parts small enough to be kept are about
twice as fast, and a loss whose gradient is taken part by part holds the activations of one part alone.
Elsewhere than on a CPU nothing is divided.
"""

from collections.abc import Callable, Iterable
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

ROWS_AT_ONCE = 50
"""Frames in a part, at least; fewer than twice as many. 25 to 100 are equally fast at the paper's sizes."""


def count_parts(num_rows: int, device: torch.device) -> int:
    """How many parts a batch is divided into."""
    return max(1, num_rows // ROWS_AT_ONCE) if device.type == "cpu" else 1


def map_parts(function: Callable[..., Tensor], *columns: Tensor) -> Tensor:
    """What a function of rows gives for a batch.

    Args:
        function: From as many tensors as there are ``columns`` to one, row by row.
        columns: As many rows each.
    """
    parts = zip(*_divide(columns), strict=True)
    return torch.cat([function(*part) for part in parts])


def mean_loss(
    module: nn.Module,
    loss: Callable[[Tensor, Tensor], Float[Tensor, " B"]],
    x: Float[Tensor, "B ..."],
    target: Float[Tensor, "B ..."],
) -> Float[Tensor, ""]:
    """Mean over a batch of the loss of each row.

    Where the batch is divided, gradients are taken at once, so they cannot be differentiated again.

    Args:
        module: Whose parameters ``loss`` reads; all that it reads beside its arguments.
        loss: Of each row, from some rows of ``x`` and of ``target``.
        x: What gradients flow back to.
        target: What they do not.
    """
    if not torch.is_grad_enabled() or count_parts(len(x), x.device) == 1:
        return loss(x, target).mean()
    weights = [weight for weight in module.parameters() if weight.requires_grad]
    return _MeanLoss.apply(loss, target, x, *weights)  # pyright: ignore[reportReturnType]


class _MeanLoss(torch.autograd.Function):
    """``mean_loss``, with the gradients taken on the way forwards."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        loss: Callable[[Tensor, Tensor], Tensor],
        target: Tensor,
        x: Tensor,
        *weights: Tensor,
    ) -> Tensor:
        total = torch.zeros((), device=x.device)
        to_x = torch.empty_like(x)
        to_weights = [torch.zeros_like(weight) for weight in weights]
        for rows, aim, place in zip(*_divide((x, target, to_x)), strict=True):
            with torch.enable_grad():
                leaf = rows.detach().requires_grad_()
                # Hooks that FLOP counters set on inputs cannot wait for a leaf within ``autograd.grad``.
                share = loss(leaf.view_as(leaf), aim).sum() / len(x)
                found = torch.autograd.grad(share, (leaf, *weights), materialize_grads=True)
            total += share.detach()
            place.copy_(found[0])
            torch._foreach_add_(to_weights, found[1:])
        ctx.save_for_backward(to_x, *to_weights)
        return total

    @staticmethod
    def backward(ctx: Any, *outer: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        return None, None, *(outer[0] * gradient for gradient in ctx.saved_tensors)


def _divide(columns: Iterable[Tensor]) -> list[tuple[Tensor, ...]]:
    return [column.tensor_split(count_parts(len(column), column.device)) for column in columns]
