"""Small building blocks: the ELU perceptron and the layer-normalised GRU cell."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from agent.models.loop import LoopLinear, autocast_dtype

L = TypeVar("L", bound=nn.Linear)


def make_mlp(in_features: int, units: int, layers: int, out_features: int | None = None) -> nn.Sequential:
    """``layers`` of Linear and ELU, then a Linear to ``out_features`` where one is given.

    Source: Table 3 (4 x 400, ELU); DreamerV2 (Glorot-uniform weights, zero bias).
    """
    modules: list[nn.Module] = []
    for _ in range(layers):
        modules += [make_linear(in_features, units), nn.ELU()]
        in_features = units
    if out_features is not None:
        modules.append(make_linear(in_features, out_features))
    return nn.Sequential(*modules)


def make_linear(in_features: int, out_features: int, *, gain: float = 1.0, kind: type[L] = nn.Linear) -> L:
    """A Linear with Glorot-uniform weights times ``gain`` and zero bias."""
    linear = kind(in_features, out_features)
    nn.init.xavier_uniform_(linear.weight, gain=gain)
    nn.init.zeros_(linear.bias)
    return linear


class LayerNormGRUCell(nn.Module):
    """GRU with one LayerNorm across its three gates and an update bias of -1 (remember by default).

    Source: DreamerV2.
    """

    def __init__(self, in_features: int, units: int) -> None:
        super().__init__()
        self.units = units
        self.linear = LoopLinear(in_features + units, 3 * units, bias=False)
        nn.init.xavier_uniform_(self.linear.weight)
        self.norm = nn.LayerNorm(3 * units, eps=1e-3)

    def forward(self, x: Float[Tensor, "B I"], hidden: Float[Tensor, "B H"]) -> Float[Tensor, "B H"]:
        """The next hidden state."""
        gates = self.norm(self.linear(torch.cat([x, hidden.to(x.dtype)], -1)).float())
        reset, candidate, update = gates.split(self.units, -1)
        candidate = torch.tanh(reset.sigmoid() * candidate)
        return torch.lerp(hidden, candidate, torch.sigmoid(update - 1))


@contextmanager
def frozen(*modules: nn.Module) -> Iterator[None]:
    """Let gradients flow through ``modules`` but not into their parameters.

    Under autocast, the weights of linear layers are cast once for the whole block, not at every use: autocast
    itself remembers its casts only of what is trained.
    """
    linears = [m for module in modules for m in module.modules() if isinstance(m, nn.Linear)]
    weights = [(linear, linear.weight) for linear in linears]
    parameters = [p for module in modules for p in module.parameters() if p.requires_grad]
    for parameter in parameters:
        parameter.requires_grad_(False)
    for linear, weight in weights:
        linear.weight = nn.Parameter(weight.to(autocast_dtype(weight)), requires_grad=False)
    try:
        yield
    finally:
        for linear, weight in weights:
            linear.weight = weight
        for parameter in parameters:
            parameter.requires_grad_(True)
