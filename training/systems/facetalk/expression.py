"""Moves heads: E takes posed points to the canonical pose, its forward twin canonical points to a pose.

Both get the point's place on the mean head, the expression code, and a few numbers compressed from the
identity code and the anchors (NPHM §3.3).
"""

import torch
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.network import Network, encode, encoded


class Deformation(Network):
    """Places on the mean head [B, P, 3] → displacements [B, P, 3] in units of the field, initially 0."""

    def __init__(self, config: HeadConfig, code_layers: list[int]):
        super().__init__(
            encoded(config.expression_octaves), config.expression_code + config.pressed,
            config.expression_width, config.expression_layers, 3, code_layers,
        )  # fmt: skip
        self.octaves = config.expression_octaves
        self.press = nn.Linear(config.identity_code + 3 * config.anchors, config.pressed)
        nn.init.normal_(self.press.weight, std=0.02)

    def move(self, place: Tensor, z: Tensor, anchors: Tensor, expression: Tensor) -> Tensor:
        """`place` [B, P, 3], `z` [B, Z], `anchors` [B, A, 3], `expression` [B, X]."""
        pressed = self.press(torch.cat([z, anchors.flatten(1)], 1))
        return self(encode(place, self.octaves), torch.cat([expression, pressed], 1))
