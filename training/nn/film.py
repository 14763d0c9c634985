"""Feature-wise linear modulation (Perez et al. 2018) of a layer's residual."""

import torch.nn.functional as F
from torch import Tensor, nn


class Film(nn.Module):
    """`x + (1 + s)·y + b`, where scale and shift come from a condition; they start at 0."""

    def __init__(self, condition_width: int, width: int, places: int):
        super().__init__()
        self.places = places
        self.linear = nn.Linear(condition_width, 2 * places * width)
        nn.init.zeros_(self.linear.weight)
        nn.init.zeros_(self.linear.bias)

    def forward(self, condition: Tensor) -> list[tuple[Tensor, Tensor]]:
        """`condition` [B, c] → scale and shift for each place, [B, 1, d]."""
        rows = self.linear(F.silu(condition))[:, None].chunk(2 * self.places, dim=-1)
        return list(zip(rows[::2], rows[1::2], strict=True))


def film(x: Tensor, y: Tensor, scale: Tensor, shift: Tensor) -> Tensor:
    """`x + (1 + s)·y + b`, all [B, T, d] or broadcast to it."""
    return x + (1.0 + scale) * y + shift
