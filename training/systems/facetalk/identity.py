"""The canonical field I(x; z_id): small networks at anchors, blended (NPHM §3.2).

Departures from the paper: coordinates in an anchor's frame are divided by the width of the blend; a
blend weight below `least_weight` is exactly zero and fades in from there, so that a point asks few networks.
Shapes: `B` heads, `Q` points of all heads, `A` anchors, `W` width.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.systems.facetalk.anchors import Anchors, mirrored
from training.systems.facetalk.config import HeadConfig


class Local(nn.Module):
    """One network for a pair of anchors, an anchor of the middle or the background.

    The point and the code join again at the layer in the middle.
    """

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.beta, self.again = config.beta, config.layers // 2
        code = config.global_code + config.local_code
        self.point = nn.ModuleList(nn.Linear(3, config.width) for _ in range(2))
        self.code = nn.ModuleList(nn.Linear(code, config.width, bias=False) for _ in range(2))
        self.hidden = nn.ModuleList(nn.Linear(config.width, config.width) for _ in range(config.layers - 1))
        self.out = nn.Linear(config.width, 1)
        for layer in self.hidden:
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)
        nn.init.kaiming_normal_(self.point[0].weight)

    def forward(self, x: Tensor, code: Tensor, head: Tensor) -> Tensor:
        """Points [Q, 3] of heads number `head` [Q] with codes [B, G + L] → [Q]."""
        h = F.softplus(self.point[0](x) + self.code[0](code)[head], beta=self.beta)
        for number, layer in enumerate(self.hidden, start=1):
            h = layer(h)
            if number == self.again:
                h = h + self.point[1](x) + self.code[1](code)[head]
            h = F.softplus(h, beta=self.beta)
        return self.out(h)[:, 0]


class Identity(nn.Module):
    """Signed distance, negative inside, in units of `scale_m`."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.config = config
        self.anchors = Anchors(config)
        self.locals = nn.ModuleList(Local(config) for _ in range(len(config.pairs) + len(config.middle) + 1))
        self.register_buffer("mirrored", mirrored(config), persistent=False)

    def codes(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """z_id [B, Z] → the global part [B, G] and the local ones [B, A + 1, L]."""
        split = self.config.global_code
        return z[:, :split], z[:, split:].unflatten(1, (self.config.anchors + 1, self.config.local_code))

    def blend(self, x: Tensor, anchors: Tensor) -> Tensor:
        """Weights of the anchors and the background at points [Q, 3], [Q, A + 1]; they sum to 1."""
        config = self.config
        distance = (x[:, None] - anchors).square().sum(-1)
        power = torch.cat([distance, torch.full_like(distance[:, :1], config.background)], 1)
        weight = torch.softmax(-power / (2.0 * config.sigma**2), dim=1)
        weight = F.relu(weight - config.least_weight)
        return weight / weight.sum(1, keepdim=True)

    def forward(self, x: Tensor, z: Tensor, head: Tensor) -> Tensor:
        """Points [Q, 3] of heads number `head` [Q] with z_id [B, Z] → [Q]."""
        own, local = self.codes(z)
        anchors = self.anchors(own)
        at = anchors[head]
        weight = self.blend(x, at)
        asked = weight.detach() > 0.0
        total = torch.zeros_like(x[:, 0])
        pairs = len(self.config.pairs)
        flip = torch.tensor([-1.0, 1.0, 1.0])
        for number in range(self.config.anchors + 1):
            rows = asked[:, number].nonzero()[:, 0]
            if len(rows) == 0:
                continue
            code = torch.cat([own, local[:, number]], 1)
            if number == self.config.anchors:
                frame = x[rows] / math.sqrt(self.config.background)
            else:
                frame = (x[rows] - at[rows, number]) / self.config.sigma
                if self.mirrored[number] > 0.0:
                    frame = frame * flip
            network = number // 2 if number < 2 * pairs else number - pairs
            made = self.locals[network](frame, code, head[rows])
            total = total.index_add(0, rows, weight[rows, number] * made)
        return total
