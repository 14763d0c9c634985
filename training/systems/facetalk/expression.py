"""How heads move: E takes posed points to the canonical pose, its forward twin canonical points to a pose.

Both see the expression's code and a few numbers pressed from the identity's code and anchors (NPHM §3.3).
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig


class Deformation(nn.Module):
    """Points [Q, 3] and codes → displacements [Q, 3], in units of the field; at first it moves nothing."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        width, code = config.expression_width, config.expression_code + config.pressed
        self.again = config.expression_layers // 2
        self.press = nn.Linear(config.identity_code + 3 * config.anchors, config.pressed)
        self.point = nn.ModuleList(nn.Linear(3, width) for _ in range(2))
        self.code = nn.ModuleList(nn.Linear(code, width, bias=False) for _ in range(2))
        self.hidden = nn.ModuleList(nn.Linear(width, width) for _ in range(config.expression_layers - 1))
        self.out = nn.Linear(width, 3)
        for layer in self.hidden:
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)
        nn.init.normal_(self.point[0].weight, std=4.0)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, x: Tensor, z: Tensor, anchors: Tensor, expression: Tensor, head: Tensor) -> Tensor:
        """`z` [B, Z], `anchors` [B, A, 3], `expression` [B, X], `head` [Q]."""
        code = torch.cat([expression, self.press(torch.cat([z, anchors.flatten(1)], 1))], 1)
        h = F.relu(self.point[0](x) + self.code[0](code)[head])
        for number, layer in enumerate(self.hidden, start=1):
            h = layer(h)
            if number == self.again:
                h = h + self.point[1](x) + self.code[1](code)[head]
            h = F.relu(h)
        return self.out(h)
