"""Causal self-attention that prefers near rows, in steps of a period (FaceFormer, Fan et al. 2022, eq. 5).

Row i sees rows j ≤ i with the bias −slope_h · ⌊(i − j) / p⌋. Each head has its own slope, chosen as in ALiBi
(Press et al. 2022). Keys and values of earlier rows can be cached, so that only the new row is computed.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn


def slopes(heads: int) -> Tensor:
    """2^(−8 h / heads) for h from 1, [heads]."""
    return 2.0 ** (-8.0 * torch.arange(1, heads + 1) / heads)


def temporal_bias(rows: int, heads: int, period: int, look_back: int) -> Tensor:
    """Bias of the scores, [heads, T, T]: −∞ for later rows and for rows `look_back` or more behind."""
    behind = torch.arange(rows)[:, None] - torch.arange(rows)[None, :]
    bias = -slopes(heads)[:, None, None] * torch.div(behind, period, rounding_mode="floor")
    return bias.masked_fill((behind < 0) | (behind >= look_back), -torch.inf)


class BiasedSelfAttention(nn.Module):
    """Parameters as `torch.nn.MultiheadAttention` names them."""

    def __init__(self, width: int, heads: int, period: int, look_back: int):
        super().__init__()
        if width % heads:
            raise ValueError(f"width: expected a multiple of {heads} heads, got {width}")
        self.heads, self.period, self.look_back = heads, period, look_back
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)

    def forward(self, x: Tensor) -> Tensor:
        """`x` [B, T, d] → [B, T, d]."""
        q, k, v = self._projected(x)
        bias = temporal_bias(x.shape[1], self.heads, self.period, self.look_back)
        mixed = F.scaled_dot_product_attention(q, k, v, attn_mask=bias.to(x))
        return self.out_proj(mixed.transpose(1, 2).flatten(2))

    def step(self, x: Tensor, cache: list[tuple[Tensor, Tensor]]) -> Tensor:
        """The next row [B, 1, d] → [B, 1, d].

        `cache` holds keys and values of the rows before. This adds those of the new row and drops
        those that are `look_back` or more behind.
        """
        q, k, v = self._projected(x)
        cache.append((k, v))
        del cache[: -self.look_back]
        keys, values = (torch.cat(part, dim=2) for part in zip(*cache, strict=True))
        behind = torch.arange(len(cache) - 1, -1, -1)
        bias = -slopes(self.heads)[:, None, None] * torch.div(behind, self.period, rounding_mode="floor")
        mixed = F.scaled_dot_product_attention(q, keys, values, attn_mask=bias.to(x))
        return self.out_proj(mixed.transpose(1, 2).flatten(2))

    def _projected(self, x: Tensor) -> list[Tensor]:
        joint = F.linear(x, self.in_proj_weight, self.in_proj_bias).chunk(3, dim=-1)
        return [part.unflatten(2, (self.heads, -1)).transpose(1, 2) for part in joint]


def periodic_positions(first: int, rows: int, width: int, period: int) -> Tensor:
    """Sinusoids of frames `first` … `first + rows − 1`, counted modulo the period, [T, d]; ibid. eq. 4."""
    at = (torch.arange(first, first + rows) % period)[:, None]
    rate = 10000.0 ** (-torch.arange(0, width, 2) / width)
    return torch.stack([torch.sin(at * rate), torch.cos(at * rate)], dim=-1).flatten(1)[:, :width]
