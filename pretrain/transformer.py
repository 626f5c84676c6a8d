"""Pre-norm transformer layers and fixed positions: the building blocks of every ViT in the project."""

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn


def sincos_2d(rows: Tensor, columns: Tensor, dim: int) -> Float[Tensor, "N D"]:
    """Fixed sine-cosine positions: half of the channels for the row, half for the column.

    Works for grids of any shape, and for single cells outside the grid.

    Source: MAE (pos_embed), which asserts square grids; the frequencies are those of Vaswani et al.
    """
    frequencies = 10000.0 ** -(torch.arange(dim // 4, dtype=torch.float64) / (dim // 4))

    def encode(cells: Tensor) -> Tensor:
        angles = cells.double()[:, None] * frequencies
        return torch.cat([angles.sin(), angles.cos()], dim=1)

    return torch.cat([encode(rows), encode(columns)], dim=1).float()


def grid_positions(grid: tuple[int, int], dim: int) -> Float[Tensor, "N D"]:
    """``sincos_2d`` of every cell of a grid, row by row."""
    rows, columns = torch.meshgrid(torch.arange(grid[0]), torch.arange(grid[1]), indexing="ij")
    return sincos_2d(rows.flatten(), columns.flatten(), dim)


class Dropout(nn.Module):
    """Dropout in which one random number of 64 bits decides about four entries.

    Drawing the masks with PyTorch's own takes an eighth of a training step on a CPU. Probabilities are
    rounded to 1/65536.
    """

    def __init__(self, probability: float) -> None:
        super().__init__()
        self.probability = probability

    def forward(self, x: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """In training, zero entries at random and scale up the others."""
        if not self.training or self.probability == 0:
            return x
        draws = torch.empty((x.numel() + 3) // 4, dtype=torch.int64, device=x.device).random_(-(2**63), None)
        chances = draws.view(torch.int16)[: x.numel()].view(x.shape)
        keep = torch.ge(chances, round(self.probability * 2**16) - 2**15, out=torch.empty_like(x))
        return x * keep.mul_(1 / (1 - self.probability))


class Attention(nn.Module):
    """Multi-head self-attention in which padding can be left out.

    Written as two plain matrix products: for the short sequences here (21 to 102 tokens) the fused
    kernel is slower in bf16 on a CPU.
    """

    def __init__(self, dim: int, num_heads: int) -> None:
        super().__init__()
        assert dim % num_heads == 0
        self.num_heads = num_heads
        self.qkv = nn.Linear(dim, 3 * dim)
        self.proj = nn.Linear(dim, dim)

    def forward(
        self, x: Float[Tensor, "B N D"], attend: Bool[Tensor, "B N"] | None = None
    ) -> Float[Tensor, "B N D"]:
        """Mix the tokens; those with ``attend`` false are looked at by nobody."""
        weights, values = self._look(x, attend)
        mixed = torch.bmm(weights, values)
        return self.proj(rearrange(mixed, "(b h) n d -> b n (h d)", h=self.num_heads))

    def weights(
        self, x: Float[Tensor, "B N D"], attend: Bool[Tensor, "B N"] | None = None
    ) -> Float[Tensor, "B heads N N"]:
        """How much each token (rows) looks at each other (columns), in every head; rows add up to 1."""
        return rearrange(self._look(x, attend)[0], "(b h) n m -> b h n m", h=self.num_heads)

    def _look(self, x: Tensor, attend: Tensor | None) -> tuple[Tensor, Tensor]:
        """Weights and values of every head."""
        q, k, v = rearrange(self.qkv(x), "b n (three h d) -> three (b h) n d", three=3, h=self.num_heads)
        if attend is None:
            bias, beta = q.new_zeros(1), 0
        else:
            bias, beta = _minus_infinity_where(~attend, q).repeat_interleave(self.num_heads, dim=0), 1
        scores = torch.baddbmm(bias, q, k.transpose(1, 2), beta=beta, alpha=q.shape[-1] ** -0.5)
        return scores.softmax(dim=-1), v


class Block(nn.Module):
    """One pre-norm layer: attention, then an MLP with GELU; dropout on what each adds."""

    def __init__(self, dim: int, num_heads: int, mlp_ratio: int, dropout: float, eps: float) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(dim, eps=eps)
        self.attention = Attention(dim, num_heads)
        self.norm2 = nn.LayerNorm(dim, eps=eps)
        self.mlp = nn.Sequential(nn.Linear(dim, mlp_ratio * dim), nn.GELU(), nn.Linear(mlp_ratio * dim, dim))
        self.dropout = Dropout(dropout)

    def forward(
        self, x: Float[Tensor, "B N D"], attend: Bool[Tensor, "B N"] | None = None
    ) -> Float[Tensor, "B N D"]:
        """Update the tokens."""
        x = x + self.dropout(self.attention(self.norm1(x), attend))
        return x + self.dropout(self.mlp(self.norm2(x)))


class Transformer(nn.Module):
    """A stack of blocks and a final layer norm."""

    def __init__(
        self, dim: int, num_layers: int, num_heads: int, *, mlp_ratio: int, dropout: float, eps: float
    ) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(Block(dim, num_heads, mlp_ratio, dropout, eps) for _ in range(num_layers))
        self.norm = nn.LayerNorm(dim, eps=eps)
        self.apply(_init_linear)

    def forward(
        self, x: Float[Tensor, "B N D"], attend: Bool[Tensor, "B N"] | None = None
    ) -> Float[Tensor, "B N D"]:
        """Update the tokens layer by layer, in fp32 also under autocast.

        What is added up over all rows for the norms' weights is too small to count in bf16.
        """
        x = x.float() if x.dtype == torch.bfloat16 else x
        for block in self.blocks:
            x = block(x, attend)
        return self.norm(x)


def _minus_infinity_where(ignored: Bool[Tensor, "B N"], like: Tensor) -> Float[Tensor, "B 1 N"]:
    return like.new_zeros(ignored.shape).masked_fill_(ignored, -torch.inf)[:, None]


def _init_linear(module: nn.Module) -> None:
    if isinstance(module, nn.Linear):
        nn.init.xavier_uniform_(module.weight)
        nn.init.zeros_(module.bias)
