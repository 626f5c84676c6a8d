import copy
import gc
import weakref

import pytest
import torch
from torch import nn

from agent.models.loop import LoopLinear, looping


def unroll(layer, x, steps):
    for _ in range(steps):
        x = torch.tanh(layer(x)) + x
    return x


@pytest.mark.parametrize("bias", [True, False])
def test_gradients_are_those_of_a_plain_linear_layer(bias):
    torch.manual_seed(0)
    layer = LoopLinear(5, 5, bias=bias).double()
    plain = nn.Linear(5, 5, bias=bias).double()
    plain.load_state_dict(layer.state_dict())
    x = torch.randn(3, 5, dtype=torch.double, requires_grad=True)
    y = x.detach().clone().requires_grad_()
    with looping(layer):
        ours = unroll(layer, x, 6)
    theirs = unroll(plain, y, 6)
    assert torch.equal(ours, theirs)
    weight = torch.randn_like(ours)
    (ours * weight).sum().backward()
    (theirs * weight).sum().backward()
    torch.testing.assert_close(x.grad, y.grad, rtol=1e-12, atol=1e-12)
    for a, b in zip(layer.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(a.grad, b.grad, rtol=1e-12, atol=1e-12)


def test_gradients_agree_with_differences():
    layer = LoopLinear(3, 3).double()

    def function(x, weight, bias):
        del layer.weight, layer.bias
        layer.weight, layer.bias = weight, bias  # plain tensors, so that they are functions of the arguments
        with looping(layer):
            return unroll(layer, x, 3)

    parts = [torch.randn(*s, dtype=torch.double, requires_grad=True) for s in ((2, 3), (3, 3), (3,))]
    assert torch.autograd.gradcheck(function, parts)


def test_outside_a_loop_it_is_a_plain_linear_layer():
    layer = LoopLinear(4, 2)
    with looping(layer):
        assert layer._loop is not None
    x = torch.randn(3, 4)
    assert torch.equal(layer(x), nn.functional.linear(x, layer.weight, layer.bias))
    with pytest.raises(KeyError), looping(layer):
        raise KeyError
    assert layer._loop is None


def test_under_autocast_the_sum_of_gradients_is_more_exact():
    """The plain way rounds to bf16 at every step."""
    torch.manual_seed(0)
    layer = LoopLinear(16, 16)
    plain, exact = nn.Linear(16, 16), copy.deepcopy(layer).double()
    plain.load_state_dict(layer.state_dict())
    steps = torch.randn(200, 4, 16).bfloat16().float()
    with torch.autocast("cpu", torch.bfloat16):
        with looping(layer):
            ours = torch.stack([layer(x) for x in steps])
        theirs = torch.stack([plain(x) for x in steps])
    assert torch.equal(ours, theirs)
    for result in (ours, theirs, torch.stack([exact(x.double()) for x in steps])):
        result.float().sum().backward()
    error = [(p.weight.grad - exact.weight.grad).abs().max() for p in (layer, plain)]
    assert error[0] < error[1] / 2


def test_no_gradient_is_asked_for_where_there_is_none():
    layer = LoopLinear(4, 4)
    with torch.no_grad(), looping(layer):
        assert not unroll(layer, torch.randn(2, 4), 3).requires_grad
    frozen = LoopLinear(4, 4).requires_grad_(False)
    x = torch.randn(2, 4, requires_grad=True)
    with looping(frozen):
        unroll(frozen, x, 3).sum().backward()
    assert frozen.weight.grad is None
    assert x.grad is not None


def test_weights_of_a_loop_go_with_its_graph_and_need_no_collector():
    layer = LoopLinear(4, 4)
    gc.disable()
    try:
        with looping(layer):
            loop = weakref.ref(layer._loop)
            out = unroll(layer, torch.randn(2, 4), 3)
        assert loop() is not None
        out.sum().backward()
        del out
        assert loop() is None
    finally:
        gc.enable()
    assert layer.weight.grad is not None
