"""Layer norm whose scale, shift and gate come from a condition (Peebles & Xie 2023, adaLN-Zero).

One linear layer serves all blocks. Each block adds a table of its own (Chen et al. 2024, PixArt-α,
adaLN-single).
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

PER_LAYER = 3


class AdaLn(nn.Module):
    """Shift, scale and gate of `layers` sub-layers from a condition; the gates start at 0."""

    def __init__(self, condition_width: int, width: int, layers: int):
        super().__init__()
        self.layers = layers
        self.linear = nn.Linear(condition_width, PER_LAYER * layers * width)
        nn.init.zeros_(self.linear.weight)
        nn.init.zeros_(self.linear.bias)

    def forward(self, condition: Tensor) -> Tensor:
        """`condition` [B, T, c] → [B, T, 3·layers, d]: shift, scale, gate of each sub-layer."""
        return self.linear(F.silu(condition)).unflatten(-1, (PER_LAYER * self.layers, -1))


def modulated(x: Tensor, shift: Tensor, scale: Tensor) -> Tensor:
    """`LN(x)·(1 + scale) + shift` without learned scale and shift of the norm, [B, T, d]."""
    return F.layer_norm(x, x.shape[-1:]) * (1.0 + scale) + shift


def table(layers: int, width: int) -> torch.nn.Parameter:
    """A block's own part of the modulation, [3·layers, d]."""
    return nn.Parameter(torch.randn(PER_LAYER * layers, width) / width**0.5)
