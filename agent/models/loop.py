"""Linear layers in a loop over time, whose weights' gradients are taken once for all steps.

Written step by step, every step makes a gradient as large as the weight and adds it to those before: at 16
rows a step and millions of weights, that is memory moved for little arithmetic, and under autocast the sum is
rounded at every step. Here steps only note what went in and what came back, and one product at the end gives
the same sum.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F


class LoopLinear(nn.Linear):
    """A linear layer that may stand in a loop, and is like any other where it does not."""

    _loop: "_Loop | None" = None

    def forward(self, input: Float[Tensor, "B I"]) -> Float[Tensor, "B O"]:
        """As ``nn.Linear``."""
        return super().forward(input) if self._loop is None else self._loop(input)


@contextmanager
def looping(*layers: LoopLinear) -> Iterator[None]:
    """Within, weights' gradients are put off until that of the first step has come back; same sums."""
    for layer in layers:
        layer._loop = _Loop(layer)
    try:
        yield
    finally:
        for layer in layers:
            assert layer._loop is not None
            layer._loop.end()
            layer._loop = None


def autocast_dtype(tensor: Tensor) -> torch.dtype:
    """What a product with ``tensor`` is calculated in here."""
    device = tensor.device.type
    return torch.get_autocast_dtype(device) if torch.is_autocast_enabled(device) else tensor.dtype


class _Loop:
    """One layer in one loop: its weights as they are calculated with, and what its steps have noted."""

    def __init__(self, layer: nn.Linear) -> None:
        self.dtype = autocast_dtype(layer.weight)
        self.weight = layer.weight.detach().to(self.dtype)
        self.bias = None if layer.bias is None else layer.bias.detach().to(self.dtype)
        self.inputs: list[Tensor] = []
        self.gradients: list[Tensor] = []
        self._link = _Collect.apply(layer.weight, layer.bias, self)

    def __call__(self, x: Tensor) -> Tensor:
        return _Step.apply(x.to(self.dtype), self._link, self)  # pyright: ignore[reportReturnType]

    def end(self) -> None:
        """Let go of the graph, which holds this loop: weights are freed with it and not by the collector."""
        del self._link


class _Collect(torch.autograd.Function):
    """Stands before all steps: its gradient is asked for when theirs are known."""

    @staticmethod
    def forward(ctx: Any, weight: Tensor, bias: Tensor | None, loop: _Loop) -> Tensor:  # noqa: ANN401
        ctx.loop, ctx.dtype = loop, weight.dtype
        return weight.new_zeros(())

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, Tensor | None, None]:  # noqa: ANN401
        loop: _Loop = ctx.loop
        gradient, inputs = torch.cat(loop.gradients), torch.cat(loop.inputs)
        loop.gradients, loop.inputs = [], []
        bias = None if loop.bias is None else gradient.sum(0).to(ctx.dtype)
        return (gradient.T @ inputs).to(ctx.dtype), bias, None


class _Step(torch.autograd.Function):
    """One use of the layer."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, link: Tensor, loop: _Loop) -> Tensor:  # noqa: ANN401
        ctx.loop = loop
        ctx.save_for_backward(x)
        return F.linear(x, loop.weight, loop.bias)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, Tensor, None]:  # noqa: ANN401
        loop: _Loop = ctx.loop
        (gradient,) = grad_outputs
        loop.inputs.append(ctx.saved_tensors[0])
        loop.gradients.append(gradient)
        back = gradient @ loop.weight if ctx.needs_input_grad[0] else None
        return back, gradient.new_zeros(()), None
