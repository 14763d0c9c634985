"""A pointwise network over the skin. It adds the part of a shape that landmarks cannot express.

Mirrors `rust-core/src/rig/network.rs`; attributes have the names of its layers.

    shape_s(v) = sum_n W_vn dL_sn + fade(v) R_s(features of v)

W are the training-free weights, dL_s the landmark motion of shape s on a mean face, R the network. It sees
the head and its mirror image and returns the mean of both. So a symmetric head gets symmetric shapes, and
left and right shapes are each other's mirror image.

Lengths are decimetres in the canonical frame. Shapes: `V` vertices, `N` = 68, `S` = 51 shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.deform.static_weights import FLIP, LANDMARKS, MIRROR
from training.rig.shapes import SHAPE_MIRROR

SHAPES = len(SHAPE_MIRROR)
FEATURES = 3 + 3 * LANDMARKS + LANDMARKS + LANDMARKS
OUTPUT_SCALE = 0.1
"""Outputs of the network are multiplied by this, so that training starts near zero."""
FADE_DM = (0.6, 1.0)
"""Distances from the nearest landmark.

Up to the first the network has full effect. From the second on it has none.
"""


@dataclass(frozen=True)
class RigConfig:
    """Sizes; saved beside the weights as config.json."""

    width: int = 160


CONFIGS = {"rig": RigConfig(), "debug": RigConfig(8)}


@dataclass
class SkinGeometry:
    """positions: [V, 3] dm. landmarks: [N, 3] dm, neutral. base: [V, N], training-free weights."""

    positions: Tensor
    landmarks: Tensor
    base: Tensor

    def mirrored(self) -> SkinGeometry:
        """The mirror image of this geometry."""
        return SkinGeometry(self.positions * FLIP, self.landmarks[MIRROR] * FLIP, self.base[:, MIRROR])

    def features(self) -> Tensor:
        """Position, offset from and distance to each landmark, weights. [V, 343]."""
        offsets = self.positions[:, None] - self.landmarks
        return torch.cat([self.positions, offsets.flatten(1), offsets.norm(dim=-1), self.base], dim=1)

    def fade(self) -> Tensor:
        """[V], one near the landmarks, zero where the network has no effect."""
        nearest = (self.positions[:, None] - self.landmarks).norm(dim=-1).min(1).values
        near, far = FADE_DM
        return ((far - nearest) / (far - near)).clamp(0.0, 1.0)


class RigNetwork(nn.Module):
    """The network R of the formula above."""

    def __init__(self, config: RigConfig):
        super().__init__()
        self.config = config
        w = config.width
        self.layer_0 = nn.Linear(FEATURES, w)
        self.layer_1 = nn.Linear(w, w)
        self.layer_2 = nn.Linear(w, w)
        self.out = nn.Linear(w, 3 * SHAPES)
        self.register_buffer("feature_mean", torch.zeros(FEATURES))
        self.register_buffer("feature_scale", torch.ones(FEATURES))
        self.register_buffer("templates", torch.zeros(SHAPES, LANDMARKS, 3))
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def one_sided(self, geometry: SkinGeometry) -> Tensor:
        """Residual of each shape without the mirror. [S, V, 3] dm."""
        x = (geometry.features() - self.feature_mean) / self.feature_scale
        for layer in (self.layer_0, self.layer_1, self.layer_2):
            x = torch.nn.functional.silu(layer(x))
        out = OUTPUT_SCALE * geometry.fade()[:, None] * self.out(x)
        return out.unflatten(1, (SHAPES, 3)).transpose(0, 1)

    def spread(self, geometry: SkinGeometry) -> Tensor:
        """The templates spread by the training-free weights. [S, V, 3] dm."""
        return torch.einsum("vn,snx->svx", geometry.base, self.templates)

    def forward(self, geometry: SkinGeometry) -> Tensor:
        """Every shape of the skin. [S, V, 3] dm."""
        reflected = self.one_sided(geometry.mirrored())[SHAPE_MIRROR] * FLIP
        return self.spread(geometry) + 0.5 * (self.one_sided(geometry) + reflected)
