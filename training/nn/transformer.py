"""Transformer decoder layer with the parameter names of `torch.nn.TransformerDecoderLayer`."""

import torch.nn.functional as F
from torch import Tensor, nn

from training.nn.attention import MultiheadAttention


class TransformerDecoderLayer(nn.Module):
    """Self-attention, cross-attention, feed-forward; exact GELU; pre- or post-norm.

    Matches `torch.nn.TransformerDecoderLayer(activation="gelu", batch_first=True)` in every
    number. `norm` is "pre" (Xiong et al. 2020) or "post" (Vaswani et al. 2017).
    """

    def __init__(self, width: int, heads: int, feedforward: int, norm: str, dropout: float = 0.0):
        super().__init__()
        if norm not in ("pre", "post"):
            raise ValueError(f"norm: expected pre or post, got {norm!r}")
        self.pre_norm = norm == "pre"
        self.self_attn = MultiheadAttention(width, heads)
        self.multihead_attn = MultiheadAttention(width, heads)
        self.linear1 = nn.Linear(width, feedforward)
        self.linear2 = nn.Linear(feedforward, width)
        self.norm1 = nn.LayerNorm(width)
        self.norm2 = nn.LayerNorm(width)
        self.norm3 = nn.LayerNorm(width)
        self.dropout = nn.Dropout(dropout)

    def forward(
        self,
        x: Tensor,
        memory: Tensor,
        self_allowed: Tensor | None = None,
        cross_allowed: Tensor | None = None,
    ) -> Tensor:
        """`x` [B, T, d], `memory` [B, M, d]; masks as in `MultiheadAttention`. → [B, T, d]."""
        if self.pre_norm:
            y = self.norm1(x)
            x = x + self.dropout(self.self_attn(y, y, self_allowed))
            x = x + self.dropout(self.multihead_attn(self.norm2(x), memory, cross_allowed))
            return x + self.dropout(self._feedforward(self.norm3(x)))
        x = self.norm1(x + self.dropout(self.self_attn(x, x, self_allowed)))
        x = self.norm2(x + self.dropout(self.multihead_attn(x, memory, cross_allowed)))
        return self.norm3(x + self.dropout(self._feedforward(x)))

    def _feedforward(self, x: Tensor) -> Tensor:
        return self.linear2(self.dropout(F.gelu(self.linear1(x))))
