"""Where the local networks sit: 21 landmarks from the global code (NPHM, Giebenhain et al. 2023, §3.2)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig


class Anchors(nn.Module):
    """Global code [B, G] → anchors [B, A, 3] in units of the field; pairs first, then the middle."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.hidden = nn.Linear(config.global_code, config.anchor_width)
        self.out = nn.Linear(config.anchor_width, 3 * config.anchors)
        nn.init.normal_(self.out.weight, std=1e-3)

    def forward(self, code: Tensor) -> Tensor:
        """Codes to anchors."""
        return self.out(F.relu(self.hidden(code))).unflatten(-1, (-1, 3))


def numbers(config: HeadConfig) -> list[int]:
    """The landmark of every anchor."""
    return [number for pair in config.pairs for number in pair] + list(config.middle)


def mirrored(config: HeadConfig) -> Tensor:
    """1 for anchors whose frame is the mirror image of their partner's, [A]."""
    signs = [0.0, 1.0] * len(config.pairs) + [0.0] * len(config.middle)
    return torch.tensor(signs)
