"""Residual blocks of dilated convolutions, of which speech encoders are built."""

import torch.nn.functional as F
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """x + mix(GELU(conv(norm(x)))) on [B, T, C]; `conv` has 3 taps `dilation` apart."""

    def __init__(self, channels: int, dilation: int):
        super().__init__()
        self.norm = nn.LayerNorm(channels)
        self.conv = nn.Conv1d(channels, channels, 3, padding=dilation, dilation=dilation)
        self.mix = nn.Linear(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        """[B, T, C] → [B, T, C]; zeros stand beyond both ends."""
        y = self.conv(self.norm(x).transpose(1, 2)).transpose(1, 2)
        return x + self.mix(F.gelu(y))
