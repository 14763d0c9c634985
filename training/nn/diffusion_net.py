"""DiffusionNet (Sharp, Attaiki, Crane, Ovsjanikov 2022): learning on surfaces by diffusion.

Mirrors `rust-core/src/nn/diffusion_net.rs`; attribute names are those of the authors' own
checkpoints (`first_lin`, `block_0.diffusion.diffusion_time`, ...), so weights need no renaming.

Shapes: `B` frames, `V` vertices, `C` channels, `K` eigenpairs.
Differs from the authors' code: no dropout; the spectral method only; the leading axis is a batch of
feature fields over *one* mesh, because the operators do not change from frame to frame.
"""

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass
class SurfaceOperators:
    """Operators of a surface that the network needs, all in the same unit of length.

    mass: [V], area. evals: [K], 1/area. evecs: [V, K], mass-orthonormal.
    grad_x, grad_y: sparse CSR [V, V], 1/length, in any tangent frame per vertex.
    """

    mass: Tensor
    evals: Tensor
    evecs: Tensor
    grad_x: Tensor
    grad_y: Tensor


class LearnedTimeDiffusion(nn.Module):
    """`out_c = Phi exp(-lambda t_c) Phi^T M x_c`, Sharp et al. 2022, eq. 5."""

    def __init__(self, width: int):
        super().__init__()
        self.diffusion_time = nn.Parameter(torch.zeros(width))

    def forward(self, x: Tensor, ops: SurfaceOperators) -> Tensor:
        """x: [B, V, C]. Returns [B, V, C]."""
        time = self.diffusion_time.clamp(min=1e-8)
        spectrum = ops.evecs.T @ (x * ops.mass[:, None])
        return ops.evecs @ (torch.exp(-ops.evals[:, None] * time) * spectrum)


class SpatialGradientFeatures(nn.Module):
    """`tanh(Re(conj(g) . A g))` with a complex matrix A: inner products of gradients, eq. 8."""

    def __init__(self, width: int):
        super().__init__()
        self.A_re = nn.Linear(width, width, bias=False)
        self.A_im = nn.Linear(width, width, bias=False)

    def forward(self, grad_x: Tensor, grad_y: Tensor) -> Tensor:
        """grad_x, grad_y: [B, V, C]. Returns [B, V, C]."""
        real = self.A_re(grad_x) - self.A_im(grad_y)
        imaginary = self.A_re(grad_y) + self.A_im(grad_x)
        return torch.tanh(grad_x * real + grad_y * imaginary)


class MiniMLP(nn.Sequential):
    """Linear layers with ReLU between them, named as the authors name them."""

    def __init__(self, sizes: list[int]):
        super().__init__()
        last = len(sizes) - 2
        for i, (a, b) in enumerate(itertools.pairwise(sizes)):
            self.add_module(f"miniMLP_mlp_layer_{i:03d}", nn.Linear(a, b))
            if i < last:
                self.add_module(f"miniMLP_mlp_act_{i:03d}", nn.ReLU())


class DiffusionNetBlock(nn.Module):
    """Diffuse, take gradient features, mix by an MLP, add to the input."""

    def __init__(self, width: int):
        super().__init__()
        self.diffusion = LearnedTimeDiffusion(width)
        self.gradient_features = SpatialGradientFeatures(width)
        self.mlp = MiniMLP([3 * width, width, width, width])

    def forward(self, x: Tensor, ops: SurfaceOperators) -> Tensor:
        """x: [B, V, C]. Returns [B, V, C]."""
        diffused = self.diffusion(x, ops)
        features = self.gradient_features(
            apply_sparse(ops.grad_x, diffused), apply_sparse(ops.grad_y, diffused)
        )
        return x + self.mlp(torch.cat([x, diffused, features], dim=-1))


class DiffusionNet(nn.Module):
    """`blocks` DiffusionNet blocks of `width` channels between two linear layers."""

    def __init__(self, inputs: int, outputs: int, width: int, blocks: int):
        super().__init__()
        self.blocks = blocks
        self.first_lin = nn.Linear(inputs, width)
        for i in range(blocks):
            self.add_module(f"block_{i}", DiffusionNetBlock(width))
        self.last_lin = nn.Linear(width, outputs)

    def forward(self, x: Tensor, ops: SurfaceOperators) -> Tensor:
        """x: [B, V, inputs]. Returns [B, V, outputs]."""
        x = self.first_lin(x)
        for i in range(self.blocks):
            x = self.get_submodule(f"block_{i}")(x, ops)
        return self.last_lin(x)


def apply_sparse(matrix: Tensor, x: Tensor) -> Tensor:
    """matrix: sparse [V, V]; x: [B, V, C]. Returns [B, V, C] in f32, the product's lowest precision."""
    batch, vertices, channels = x.shape
    flat = x.float().transpose(0, 1).reshape(vertices, batch * channels)
    with torch.autocast(x.device.type, enabled=False):
        return (matrix @ flat).reshape(vertices, batch, channels).transpose(0, 1)
