"""Attention, blocks and positions against PyTorch's own."""

import pytest
import torch
from torch import nn

from pretrain.transformer import Attention, Block, Dropout, Transformer, grid_positions, sincos_2d

DIM, HEADS = 32, 4


def torch_layer(block: Block) -> nn.TransformerEncoderLayer:
    """PyTorch's pre-norm layer with the weights of ours."""
    layer = nn.TransformerEncoderLayer(
        DIM,
        HEADS,
        4 * DIM,
        dropout=0.0,
        activation="gelu",
        layer_norm_eps=1e-6,
        batch_first=True,
        norm_first=True,
    )
    layer.load_state_dict(
        {
            "self_attn.in_proj_weight": block.attention.qkv.weight,
            "self_attn.in_proj_bias": block.attention.qkv.bias,
            "self_attn.out_proj.weight": block.attention.proj.weight,
            "self_attn.out_proj.bias": block.attention.proj.bias,
            "linear1.weight": block.mlp[0].weight,
            "linear1.bias": block.mlp[0].bias,
            "linear2.weight": block.mlp[2].weight,
            "linear2.bias": block.mlp[2].bias,
            "norm1.weight": block.norm1.weight,
            "norm1.bias": block.norm1.bias,
            "norm2.weight": block.norm2.weight,
            "norm2.bias": block.norm2.bias,
        }
    )
    return layer


@pytest.mark.parametrize("has_padding", [False, True])
def test_transformer_agrees_with_torchs_layers(has_padding):
    torch.manual_seed(0)
    ours = Transformer(DIM, 2, HEADS, mlp_ratio=4, dropout=0.1, eps=1e-6).eval()
    x = torch.randn(3, 9, DIM)
    attend = torch.arange(9) < torch.tensor([[9], [6], [2]]) if has_padding else None
    theirs = x
    for block in ours.blocks:
        theirs = torch_layer(block)(theirs, src_key_padding_mask=None if attend is None else ~attend)
    torch.testing.assert_close(ours(x, attend), ours.norm(theirs), rtol=1e-5, atol=1e-5)


def test_attention_agrees_with_torchs_in_training_too():
    torch.manual_seed(1)
    ours, theirs = Attention(DIM, HEADS), nn.MultiheadAttention(DIM, HEADS, batch_first=True)
    theirs.load_state_dict(
        {
            "in_proj_weight": ours.qkv.weight,
            "in_proj_bias": ours.qkv.bias,
            "out_proj.weight": ours.proj.weight,
            "out_proj.bias": ours.proj.bias,
        }
    )
    x = torch.randn(2, 5, DIM)
    ours(x).square().sum().backward()
    theirs(x, x, x, need_weights=False)[0].square().sum().backward()
    torch.testing.assert_close(ours.qkv.weight.grad, theirs.in_proj_weight.grad, rtol=1e-4, atol=1e-4)


def test_padding_changes_nothing():
    torch.manual_seed(2)
    block = Block(DIM, HEADS, mlp_ratio=4, dropout=0.0, eps=1e-6)
    x, other = torch.randn(1, 6, DIM), torch.randn(1, 6, DIM)
    attend = torch.arange(6)[None] < 4
    changed = torch.where(attend[..., None], x, other)
    torch.testing.assert_close(block(x, attend)[:, :4], block(changed, attend)[:, :4])


def test_dropout_acts_in_training_only():
    torch.manual_seed(3)
    block = Block(DIM, HEADS, mlp_ratio=4, dropout=0.5, eps=1e-6)
    x = torch.randn(1, 6, DIM)
    assert not torch.equal(block(x), block(x))
    assert torch.equal(block.eval()(x), block(x))


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize("probability", [0.1, 0.5, 0.99])
def test_dropout_has_the_distribution_of_torchs(probability, dtype):
    torch.manual_seed(4)
    ours, theirs = Dropout(probability), nn.Dropout(probability)
    x = torch.ones(400_003, dtype=dtype)  # no multiple of four
    for found in (ours(x), theirs(x)):
        assert found.unique().tolist() == [0, pytest.approx(1 / (1 - probability), rel=4e-3)]
        assert (found == 0).float().mean() == pytest.approx(probability, abs=0.004)


def test_dropout_decides_about_each_entry_on_its_own():
    torch.manual_seed(5)
    is_dropped = (Dropout(0.3)(torch.ones(100_000, 4)) == 0).double()
    correlation = torch.corrcoef(torch.cat([is_dropped[:-1], is_dropped[1:]], dim=1).T)
    assert (correlation - torch.eye(8)).abs().max() < 0.02


def test_dropout_passes_gradient_where_it_passes_values():
    torch.manual_seed(6)
    x = torch.ones(3, 7, 5, requires_grad=True)
    found = Dropout(0.4)(x)
    found.sum().backward()
    assert torch.equal(x.grad, found)


def test_dropout_repeats_with_the_seed():
    x = torch.ones(2, 99)
    found = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        found.append(Dropout(0.5)(x))
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


def test_positions_tell_every_cell_of_a_rectangle_apart():
    positions = grid_positions((8, 10), 256)
    assert positions.shape == (80, 256)
    distances = torch.cdist(positions, positions) + 10 * torch.eye(80)
    assert distances.min() > 0.1


def test_positions_are_sines_and_cosines_of_row_and_column():
    row, column, dim = 3, 7, 16
    position = sincos_2d(torch.tensor([row]), torch.tensor([column]), dim)[0]
    for k in range(4):
        frequency = 10000 ** (-k / 4)
        for start, cell in ((0, row), (8, column)):
            angle = torch.tensor(cell * frequency, dtype=torch.float64)
            assert position[start + k].item() == pytest.approx(angle.sin().item(), abs=1e-6)
            assert position[start + 4 + k].item() == pytest.approx(angle.cos().item(), abs=1e-6)


def test_under_autocast_the_norms_learn_what_they_learn_in_fp32():
    torch.manual_seed(0)
    net = Transformer(16, 1, 2, mlp_ratio=2, dropout=0.0, eps=1e-6)
    x, wanted = torch.randn(400, 22, 16), torch.rand(16)
    found = {}
    for dtype in (torch.float32, torch.bfloat16):
        net.zero_grad()
        with torch.autocast("cpu", torch.bfloat16, enabled=dtype == torch.bfloat16):
            out = net(x.to(dtype))
        (out * wanted).sum().backward()
        found[dtype] = {name: p.grad.clone() for name, p in net.named_parameters() if "norm" in name}
    assert len(found[torch.bfloat16]) == 6
    for name, exact in found[torch.float32].items():
        error = (found[torch.bfloat16][name] - exact).norm() / exact.norm()
        assert error < 0.02, name
