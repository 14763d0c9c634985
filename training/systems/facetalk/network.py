"""Layers with two inputs, a point and a code.

A point enters twice. A code enters up to three times: it adds rows, and it changes the last matrix. Its part
is the same for all points of a head (or a frame), so it is computed once for all of them.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn


def encode(x: Tensor, octaves: int) -> Tensor:
    """[..., 3] → [..., 3 + 6·octaves]: the point, then sin(2^k π x), cos(2^k π x) for k = 0 … octaves − 1."""
    parts = [x]
    for k in range(octaves):
        angle = 2.0**k * math.pi * x
        parts += [angle.sin(), angle.cos()]
    return torch.cat(parts, -1)


def encoded(octaves: int) -> int:
    """Number of values that `encode` returns for a point."""
    return 3 + 6 * octaves


def widened(state: dict[str, Tensor], octaves: int) -> dict[str, Tensor]:
    """A head's tensors for deformations with `octaves`.

    The weights of the added finer octaves are 0, so outputs stay the same. Raises ValueError if the head
    already has more octaves.
    """
    wider = dict(state)
    for name, weight in state.items():
        if name.split(".")[0] in ("backward_field", "forward_field") and name.split(".")[1:2] == ["point"]:
            more = encoded(octaves) - weight.shape[-1] if weight.dim() == 2 else 0
            if more < 0:
                raise ValueError(f"octaves: expected at least {(weight.shape[-1] - 3) // 6}, got {octaves}")
            wider[name] = torch.cat([weight, weight.new_zeros(len(weight), more)], 1) if more else weight
    return wider


class Network(nn.Module):
    """Points [B, P, I] and codes [B, C] → [B, P, O].

    The point enters again at the middle layer. The code enters at `code_layers`. It also changes the output
    layer, which maps the last hidden layer h to `(W + M(code)) h + b + m(code)`. The output is 0 initially.
    """

    def __init__(self, inputs: int, code: int, width: int, layers: int, outputs: int, code_layers: list[int]):
        super().__init__()
        self.again, self.code_layers = layers // 2, list(code_layers)
        self.width, self.outputs = width, outputs
        self.point = nn.ModuleList(nn.Linear(inputs, width) for _ in range(2))
        self.code = nn.ModuleList(nn.Linear(code, width, bias=False) for _ in code_layers)
        self.hidden = nn.ModuleList(nn.Linear(width, width) for _ in range(layers - 1))
        self.out = nn.Linear(width, outputs)
        self.out_code = nn.Linear(code, outputs * (width + 1), bias=False)
        for layer in self.hidden:
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)
        for layer in self.code:
            nn.init.normal_(layer.weight, std=0.1 / math.sqrt(code))
        for tensor in (self.out.weight, self.out.bias, self.out_code.weight):
            nn.init.zeros_(tensor)

    def trunk(self, x: Tensor, code: Tensor, last: int) -> Tensor:
        """Output of the layers before number `last`, [B, P, W]."""
        return self._layers(None, x, code, 0, last)

    def forward(self, x: Tensor, code: Tensor) -> Tensor:
        """Points [B, P, I] and codes [B, C] → [B, P, O]."""
        return self.read_out(self._layers(None, x, code, 0, len(self.hidden) + 1), code)

    def _layers(self, h: Tensor | None, x: Tensor, code: Tensor, first: int, last: int) -> Tensor:
        for number in range(first, last):
            h = self.point[0](x) if number == 0 else self.hidden[number - 1](h)
            if number == self.again:
                h = h + self.point[1](x)
            if number in self.code_layers:
                h = h + self.code[self.code_layers.index(number)](code)[:, None]
            h = F.silu(h)
        return h

    def read_out(self, h: Tensor, code: Tensor) -> Tensor:
        """The output layer. Each code makes its own matrix."""
        matrix = self.out_code(code).unflatten(-1, (self.outputs, self.width + 1))
        weight = self.out.weight + matrix[..., :-1]
        bias = self.out.bias + matrix[..., -1]
        return h @ weight.transpose(1, 2) + bias[:, None]


class Template(nn.Module):
    """The signed distance of the mean head in its canonical pose, in units of the field."""

    def __init__(self, octaves: int, width: int, layers: int):
        super().__init__()
        self.octaves = octaves
        sizes = [encoded(octaves)] + [width] * layers
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in zip(sizes, [*sizes[1:], 1], strict=True))
        for layer in self.layers[:-1]:
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, x: Tensor) -> Tensor:
        """Points [..., 3] → signed distances [...]."""
        h = encode(x, self.octaves)
        for layer in self.layers[:-1]:
            h = F.silu(layer(h))
        return self.layers[-1](h)[..., 0]
