"""Sinusoidal embedding of a diffusion timestep and the two-layer MLP behind embeddings."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn


def timestep_embedding(timestep: Tensor, width: int) -> Tensor:
    """Sinusoids of the timestep, [B] → [B, width]; width even.

    `[sin(t ω_k) …, cos(t ω_k) …]`, `ω_k = 10000^(−k / (width/2))`, k = 0 … width/2 − 1
    (Ho et al. 2020, after Vaswani et al. 2017). All sines stand before all cosines.
    """
    half = width // 2
    k = torch.arange(half, device=timestep.device, dtype=torch.float32)
    omega = torch.exp(-math.log(10000.0) * k / half)
    angle = timestep.float()[:, None] * omega[None]
    return torch.cat([angle.sin(), angle.cos()], dim=1)


class Mlp(nn.Module):
    """linear1 → SiLU → linear2."""

    def __init__(self, inputs: int, hidden: int, outputs: int):
        super().__init__()
        self.linear1 = nn.Linear(inputs, hidden)
        self.linear2 = nn.Linear(hidden, outputs)

    def forward(self, x: Tensor) -> Tensor:
        """`x` [..., inputs] → [..., outputs]."""
        return self.linear2(F.silu(self.linear1(x)))
