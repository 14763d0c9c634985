"""The parametric head F(x, z_id, z_ex) = I(x + E(x; z_id, z_ex); z_id), eq. 1 and §5.

The identity code is a linear map of ICT's coefficients. So a head that training never saw has a code at once,
and coefficients from N(0, 1) give random heads. The expression code is a linear map of ARKit weights. It is 0
in the canonical pose, where the jaw is open by `open_jaw`.
"""

import torch
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.expression import Deformation
from training.systems.facetalk.identity import Identity

COEFFICIENTS = 100
DIRECTIONS = 10


class Principal(nn.Module):
    """Orthonormal directions of the coefficients, [10, 100]. The first moves the surface furthest."""

    def __init__(self):
        super().__init__()
        self.register_buffer("directions", torch.eye(DIRECTIONS, COEFFICIENTS))


class Head(nn.Module):
    """Both fields (identity and backward deformation), the forward deformation, and the maps to codes."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.config = config
        self.identity = Identity(config)
        middle, last = config.expression_layers // 2, config.expression_layers - 1
        self.backward_field = Deformation(config, [0, middle])
        self.forward_field = Deformation(config, [last])
        self.identity_code = nn.Linear(COEFFICIENTS, config.identity_code)
        self.expression_code = nn.Linear(len(config.channels), config.expression_code, bias=False)
        self.principal = Principal()
        nn.init.normal_(self.identity_code.weight, std=0.1)
        nn.init.zeros_(self.identity_code.bias)
        nn.init.orthogonal_(self.expression_code.weight)

    def expression(self, weights: Tensor) -> Tensor:
        """ARKit weights [..., M] → z_ex [..., X]."""
        rest = torch.zeros(len(self.config.channels), device=weights.device)
        rest[self.config.channels.index("jawOpen")] = self.config.open_jaw
        return self.expression_code(weights - rest)

    def place(self, x: Tensor, z: Tensor) -> Tensor:
        """Maps points [B, P, 3] to their places on the mean head."""
        return x + self.identity.to_mean(x, z)

    def posed(self, x: Tensor, z: Tensor, expression: Tensor) -> Tensor:
        """Moves canonical points [B, P, 3] to the pose of `expression` [B, X]."""
        anchors = self.identity.anchors(z)
        return x + self.forward_field.move(self.place(x, z), z, anchors, expression)

    def canonical(self, x: Tensor, z: Tensor, expression: Tensor) -> Tensor:
        """Moves posed points [B, P, 3] to the canonical pose."""
        anchors = self.identity.anchors(z)
        return x + self.backward_field.move(self.place(x, z), z, anchors, expression)

    def forward(self, x: Tensor, z: Tensor, expression: Tensor) -> Tensor:
        """Signed distance [B, P] of posed points [B, P, 3], eq. 1."""
        return self.identity(self.canonical(x, z, expression), z)
