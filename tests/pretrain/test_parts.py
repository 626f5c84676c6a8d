"""Batches in parts: the same numbers and the same gradients as in one piece."""

import pytest
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from pretrain import parts
from pretrain.parts import count_parts, map_parts, mean_loss


@pytest.fixture
def net() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(5, 8), nn.LayerNorm(8), nn.ELU(), nn.Linear(8, 3))


def gradients(net: nn.Module, x: torch.Tensor) -> list[torch.Tensor]:
    return [g for g in (x.grad, *(p.grad for p in net.parameters())) if g is not None]


def test_parts_have_50_to_99_rows_on_a_cpu_and_all_of_them_elsewhere():
    cpu = torch.device("cpu")
    assert [count_parts(n, cpu) for n in (1, 49, 99, 100, 149, 800)] == [1, 1, 1, 2, 2, 16]
    assert count_parts(800, torch.device("cuda")) == 1


@pytest.mark.parametrize("precision", [torch.float32, torch.bfloat16])
def test_a_loss_in_parts_is_that_of_the_whole(net, monkeypatch, precision):
    target, found = torch.randn(7, 3), []
    for rows in (50, 2):
        monkeypatch.setattr(parts, "ROWS_AT_ONCE", rows)
        torch.manual_seed(1)
        x = torch.randn(7, 5, requires_grad=True)
        net.zero_grad()
        with torch.autocast("cpu", precision, enabled=precision != torch.float32):
            loss = mean_loss(net, lambda x, t: (net(x).float() - t).square().sum(-1), x, target)
            (3 * loss).backward()
        found.append((loss.detach(), gradients(net, x)))
    (whole, expected), (divided, got) = found
    tolerance = {"rtol": 1e-5, "atol": 1e-6} if precision == torch.float32 else {"rtol": 0.05, "atol": 0.05}
    torch.testing.assert_close(divided, whole, **tolerance)
    assert len(got) == 7
    torch.testing.assert_close(got, expected, **tolerance)


def test_what_is_not_trained_gets_no_gradient(net, monkeypatch):
    monkeypatch.setattr(parts, "ROWS_AT_ONCE", 2)
    net[0].requires_grad_(False)
    x = torch.randn(7, 5, requires_grad=True)
    mean_loss(net, lambda x, t: (net(x) - t).square().sum(-1), x, torch.zeros(7, 3)).backward()
    assert net[0].weight.grad is None
    assert x.grad is not None
    assert net[3].weight.grad is not None


def test_gradients_are_taken_part_by_part(net, monkeypatch):
    """No more than one part's activations are there at once: each is over before the next begins."""
    monkeypatch.setattr(parts, "ROWS_AT_ONCE", 2)
    order: list[str] = []

    def loss(x, t):
        order.append(f"forward {len(x)}")
        out = net(x)
        out.register_hook(lambda _: order.append("backward"))
        return (out - t).square().sum(-1)

    mean_loss(net, loss, torch.randn(6, 5, requires_grad=True), torch.zeros(6, 3))
    assert order == ["forward 2", "backward"] * 3


def test_flops_of_all_parts_are_counted(net, monkeypatch):
    def loss(x, t):
        return (net(x) - t).square().sum(-1)

    counted = []
    for rows in (50, 2):
        monkeypatch.setattr(parts, "ROWS_AT_ONCE", rows)
        with FlopCounterMode(display=False) as counter:
            mean_loss(net, loss, torch.randn(6, 5, requires_grad=True), torch.zeros(6, 3)).backward()
        counted.append(counter.get_total_flops())
    assert counted[0] == counted[1] > 0


def test_without_gradients_nothing_is_differentiated(net, monkeypatch):
    monkeypatch.setattr(parts, "ROWS_AT_ONCE", 2)
    x = torch.randn(7, 5)
    with torch.no_grad():
        loss = mean_loss(net, lambda x, t: (net(x) - t).square().sum(-1), x, torch.zeros(7, 3))
    torch.testing.assert_close(loss, net(x).square().sum(-1).mean().detach())
    assert not loss.requires_grad


def test_a_function_of_rows_is_applied_in_parts(net, monkeypatch):
    monkeypatch.setattr(parts, "ROWS_AT_ONCE", 2)
    x, sizes = torch.randn(7, 5, requires_grad=True), []

    def function(x, y):
        sizes.append(len(x))
        return net(x) + y

    y = torch.randn(7, 3)
    torch.testing.assert_close(map_parts(function, x, y), net(x) + y)
    assert sizes == [3, 2, 2]
