"""The parametric head F(x, z_id, z_ex) = I(x + E(x; z_id, z_ex); z_id), eq. 1 and §5.

Codes of identities are a linear map of ICT's coefficients: a head that was never seen has a code at once, and
random heads are coefficients from N(0, 1). Codes of expressions are a linear map of ARKit weights; the
canonical pose, jaw open by `open_jaw`, has the code 0.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from training.systems.facetalk.config import HeadConfig
from training.systems.facetalk.expression import Deformation
from training.systems.facetalk.identity import Identity

COEFFICIENTS = 100


class Head(nn.Module):
    """Both fields, the forward twin and the maps to codes."""

    def __init__(self, config: HeadConfig):
        super().__init__()
        self.config = config
        self.identity = Identity(config)
        self.backward_field, self.forward_field = Deformation(config), Deformation(config)
        self.identity_code = nn.Linear(COEFFICIENTS, config.identity_code)
        self.expression_code = nn.Linear(len(config.channels), config.expression_code, bias=False)
        nn.init.normal_(self.identity_code.weight, std=0.1)
        nn.init.zeros_(self.identity_code.bias)
        nn.init.normal_(self.expression_code.weight, std=0.5)

    def expression(self, weights: Tensor) -> Tensor:
        """ARKit weights [B, M] → z_ex [B, X]."""
        rest = torch.zeros(len(self.config.channels))
        rest[self.config.channels.index("jawOpen")] = self.config.open_jaw
        return self.expression_code(weights - rest)

    def posed(self, x: Tensor, z: Tensor, expression: Tensor, head: Tensor) -> Tensor:
        """Canonical points [Q, 3] in the pose."""
        anchors = self.identity.anchors(self.identity.codes(z)[0])
        return x + self.forward_field(x, z, anchors, expression, head)

    def canonical(self, x: Tensor, z: Tensor, expression: Tensor, head: Tensor) -> Tensor:
        """Posed points [Q, 3] in the canonical pose."""
        anchors = self.identity.anchors(self.identity.codes(z)[0])
        return x + self.backward_field(x, z, anchors, expression, head)

    def forward(self, x: Tensor, z: Tensor, expression: Tensor, head: Tensor) -> Tensor:
        """Signed distance [Q] of posed points [Q, 3], eq. 1."""
        return self.identity(self.canonical(x, z, expression, head), z, head)
