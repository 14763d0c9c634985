"""Multi-head attention with the parameter names of `torch.nn.MultiheadAttention`."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class MultiheadAttention(nn.Module):
    """Scaled dot-product attention, batch first (Vaswani et al. 2017, eq. 1).

    Parameters: `in_proj_weight` [3d, d] holds query, key, value in that order,
    `in_proj_bias` [3d], `out_proj.weight` [d, d], `out_proj.bias` [d].
    """

    def __init__(self, width: int, heads: int):
        super().__init__()
        if width % heads:
            raise ValueError(f"width: expected a multiple of {heads} heads, got {width}")
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)

    def forward(self, query: Tensor, memory: Tensor, allowed: Tensor | None = None) -> Tensor:
        """`query` [B, T, d], `memory` [B, M, d], `allowed` bool, broadcastable to [B, heads, T, M].

        Where `allowed` is false the score is −∞. Returns [B, T, d].
        """
        width = query.shape[-1]
        wq, wk, wv = self.in_proj_weight.split(width)
        bq, bk, bv = self.in_proj_bias.split(width)
        q = self._split_heads(F.linear(query, wq, bq))
        k = self._split_heads(F.linear(memory, wk, bk))
        v = self._split_heads(F.linear(memory, wv, bv))
        mixed = F.scaled_dot_product_attention(q, k, v, attn_mask=allowed)
        return self.out_proj(mixed.transpose(1, 2).flatten(2))

    def _split_heads(self, x: Tensor) -> Tensor:
        return x.unflatten(2, (self.heads, -1)).transpose(1, 2)


def band_mask(targets: int, memories: int, radius: int, device=None) -> Tensor:
    """True where |j − i| ≤ radius, [T, M]; FreeTalk eq. 9–10.

    Differs: the paper prints +1 outside the band, which would mask nothing. Here it is −∞.
    """
    i = torch.arange(targets, device=device)[:, None]
    j = torch.arange(memories, device=device)[None, :]
    return (j - i).abs() <= radius
