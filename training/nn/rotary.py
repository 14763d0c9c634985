"""Attention whose scores depend on how far apart frames are: rotary positions (Su et al. 2021, eq. 34)."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

BASE = 10000.0


class RotaryAttention(nn.Module):
    """Multi-head attention over frames; queries and keys are turned by their frame number.

    Parameters: `query`, `key`, `value` [inner, d], `out` [d, inner], each with a bias.
    """

    def __init__(self, width: int, inner: int, heads: int, memory_width: int | None = None):
        super().__init__()
        if inner % (2 * heads):
            raise ValueError(f"inner: expected a multiple of {2 * heads} for {heads} heads, got {inner}")
        self.heads = heads
        memory_width = width if memory_width is None else memory_width
        self.query = nn.Linear(width, inner)
        self.key = nn.Linear(memory_width, inner)
        self.value = nn.Linear(memory_width, inner)
        self.out = nn.Linear(inner, width)

    def forward(self, x: Tensor, memory: Tensor, allowed: Tensor | None = None) -> Tensor:
        """`x` [B, T, d], `memory` [B, M, e], `allowed` bool, broadcast to [B, heads, T, M]. → [B, T, d]."""
        q, k, v = (self._split(f(y)) for f, y in ((self.query, x), (self.key, memory), (self.value, memory)))
        mixed = F.scaled_dot_product_attention(turned(q), turned(k), v, attn_mask=allowed)
        return self.out(mixed.transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(2, (self.heads, -1)).transpose(1, 2)


def turned(x: Tensor) -> Tensor:
    """Turns numbers k and k + D/2 of frame t by the angle `t · BASE^(−2k/D)`, [B, heads, T, D]."""
    frames, half = x.shape[2], x.shape[3] // 2
    k = torch.arange(half, device=x.device, dtype=torch.float32)
    angle = torch.arange(frames, device=x.device)[:, None] * BASE ** (-k / half)
    cos, sin = angle.cos().to(x.dtype), angle.sin().to(x.dtype)
    a, b = x[..., :half], x[..., half:]
    return torch.cat([a * cos - b * sin, a * sin + b * cos], dim=-1)
