"""The canonical field I(x; z) = T(x + D(x; z)).

T is the mean head. D comes from small networks at anchors: it is the offset from a point to the same point of
the mean head. Anchors, frames, mirrored pairs and blend are those of NPHM (Giebenhain et al. 2023, §3.2).

Shapes: `B` heads, `P` points of each, `A` anchors, `G` and `L` lengths of the global and of a local code.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.network import Network, Template

LANDMARKS = 68


def numbers(config: HeadConfig) -> list[int]:
    """The landmark number of every anchor."""
    return [number for pair in config.pairs for number in pair] + list(config.middle)


class Identity(nn.Module):
    """Signed distance, negative inside, and the offset to the mean head, in units of `scale_m`."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.config = config
        self.landmarks = nn.Linear(config.global_code, 3 * LANDMARKS)
        self.register_buffer("mirror", torch.ones(config.global_code))
        self.locals = nn.ModuleList(
            Network(3, config.global_code + config.local_code, config.width, config.layers, 3,
                    [0, config.layers // 2])
            for _ in range(len(config.pairs) + len(config.middle) + 1)
        )  # fmt: skip
        self.template = Template(config.octaves, config.template_width, config.template_layers)

    def codes(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """Splits z_id [B, Z] into the global code [B, G] and the local ones [B, A + 1, L]."""
        split = self.config.global_code
        return z[:, :split], z[:, split:].unflatten(1, (self.config.anchors + 1, self.config.local_code))

    def places(self, z: Tensor) -> Tensor:
        """Landmarks of the canonical pose, [B, 68, 3]."""
        return self.landmarks(self.codes(z)[0]).unflatten(-1, (LANDMARKS, 3))

    def anchors(self, z: Tensor) -> Tensor:
        """Places of the anchors [B, A, 3]: pairs first, then the midline."""
        return self.places(z)[:, numbers(self.config)]

    def blend(self, x: Tensor, anchors: Tensor) -> Tensor:
        """Weights of the anchors and the background at points [B, P, 3], [B, P, A + 1]; they sum to 1."""
        config = self.config
        distance = (x[:, :, None] - anchors[:, None]).square().sum(-1)
        power = torch.cat([distance, torch.full_like(distance[..., :1], config.background)], -1)
        weight = torch.softmax(-power / (2.0 * config.sigma**2), dim=-1)
        weight = F.relu(weight - config.least_weight)
        return weight / weight.sum(-1, keepdim=True)

    def to_mean(self, x: Tensor, z: Tensor) -> Tensor:
        """D(x; z): offsets [B, P, 3] from points [B, P, 3] to the same points of the mean head.

        Each network runs only on the points where its weight is positive for any head of the batch.
        """
        config = self.config
        global_code, local = self.codes(z)
        anchors = self.anchors(z)
        weight = self.blend(x, anchors)
        active = (weight.detach() > 0.0).any(0)
        total = torch.zeros_like(x)
        pairs = len(config.pairs)
        flip = torch.tensor([-1.0, 1.0, 1.0], device=x.device)
        for number in range(config.anchors + 1):
            rows = active[:, number].nonzero()[:, 0]
            if len(rows) == 0:
                continue
            mirrored = number < 2 * pairs and number % 2 == 1
            at = x[:, rows]
            if number == config.anchors:
                frame = at / math.sqrt(config.background)
            else:
                frame = (at - anchors[:, number : number + 1]) / config.sigma
            code = torch.cat([global_code * self.mirror if mirrored else global_code, local[:, number]], 1)
            network = self.locals[number // 2 if number < 2 * pairs else number - pairs]
            offset = network(frame * flip if mirrored else frame, code)
            offset = offset * flip if mirrored else offset
            total = total.index_add(1, rows, weight[:, rows, number : number + 1] * offset)
        return total

    def forward(self, x: Tensor, z: Tensor) -> Tensor:
        """Points [B, P, 3], z_id [B, Z] → signed distances [B, P]."""
        return self.template(x + self.to_mean(x, z))
