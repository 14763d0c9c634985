"""SpiralConv3D (EmoFace, Lin et al. 2025, eq. 1 to 3): a convolution over a surface and past frames."""

import numpy as np
import torch
from torch import Tensor, nn


def spirals(vertices: np.ndarray, triangles: np.ndarray, kernel: int, dilation: int) -> np.ndarray:
    """For each vertex, every `dilation`-th vertex of a spiral from it through its rings, [V, kernel]; eq. 1.

    Within a ring, vertices are sorted by their angle about the normal, starting at the highest neighbour (of
    equally high ones, the frontmost). So the order of the triangles does not change the result. If the rings
    end before the spiral is full, the nearest vertices that are not yet in it follow.

    Raises ValueError if a vertex has no triangle, and names it; also if the mesh has too few vertices.
    """
    neighbours = _neighbours(len(vertices), triangles)
    alone = [v for v, near in enumerate(neighbours) if not near]
    if alone:
        raise ValueError(f"spirals: expected a triangle at every vertex, got none at vertex {alone[0]}")
    normals = _normals(vertices, triangles)
    length = 1 + (kernel - 1) * dilation
    if length > len(vertices):
        raise ValueError(f"spirals: expected at least {length} vertices, got {len(vertices)}")
    return np.array([_spiral(v, vertices, normals[v], neighbours, length)[::dilation]
                     for v in range(len(vertices))])  # fmt: skip


def _neighbours(count: int, triangles: np.ndarray) -> list[set[int]]:
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b, c in triangles.tolist():
        neighbours[a] |= {b, c}
        neighbours[b] |= {a, c}
        neighbours[c] |= {a, b}
    return neighbours


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(out, triangles[:, corner], cross)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)


def _spiral(
    v: int, vertices: np.ndarray, normal: np.ndarray, neighbours: list[set[int]], length: int
) -> list:
    start = max(sorted(neighbours[v]), key=lambda n: (vertices[n, 1], vertices[n, 2], vertices[n, 0]))
    ahead = vertices[start] - vertices[v]
    ahead = ahead - normal * (ahead @ normal)
    if not np.linalg.norm(ahead) > 0.0:
        ahead = np.cross(normal, [1.0, 0.0, 0.0]) + np.cross(normal, [0.0, 0.0, 1.0])
    aside = np.cross(normal, ahead)
    order, ring, disk = [v], {v}, {v}
    while len(order) < length:
        ring = set().union(*(neighbours[n] for n in ring)) - disk
        if not ring:
            break
        disk |= ring
        order += sorted(ring, key=lambda n: _turn(vertices[n] - vertices[v], ahead, aside, n, start))
    if len(order) < length:
        distance = np.linalg.norm(vertices - vertices[v], axis=1)
        order += [n for n in np.argsort(distance, kind="stable").tolist() if n not in disk]
    return order[:length]


def _turn(offset: np.ndarray, ahead: np.ndarray, aside: np.ndarray, n: int, start: int) -> tuple[float, int]:
    """Angle from `ahead`, 0 to 2π, rounded to a millionth; the start itself comes first."""
    angle = 0.0 if n == start else float(np.arctan2(offset @ aside, offset @ ahead) % (2.0 * np.pi))
    return round(angle, 6) % 6.283185, n


class SpiralConv3D(nn.Module):
    """`W f(cnt_δ(k-disk(v))) + b`, eq. 3, where `f` gathers; frames before the first are zero (eq. 2).

    `weight` [δ, kernel, in, out]: frame δ − 1 is the newest.
    """

    def __init__(self, spirals: np.ndarray, inputs: int, outputs: int, delta: int):
        super().__init__()
        self.register_buffer("spirals", torch.from_numpy(np.asarray(spirals, np.int64)), persistent=False)
        taps = delta * spirals.shape[1] * inputs
        self.weight = nn.Parameter(torch.randn(delta, spirals.shape[1], inputs, outputs) * taps**-0.5)
        self.bias = nn.Parameter(torch.zeros(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """`x` [B, T, V, in] → [B, T, V, out], tap by tap: memory grows with V·T, not with taps·V·T."""
        delta, frames = len(self.weight), x.shape[1]
        out = self.bias.expand(*x.shape[:-1], -1).clone()
        for d in range(delta):
            behind = delta - 1 - d
            past = x[:, : frames - behind]
            for k in range(self.weight.shape[1]):
                out[:, behind:] += past[:, :, self.spirals[:, k]] @ self.weight[d, k]
        return out

    def of_sum(self, in_time: Tensor, on_surface: Tensor) -> Tensor:
        """`forward` of `in_time[b, t] + on_surface[v]`, in parts: [B, T, in], [V, in] → [B, T, V, out]."""
        delta, frames = len(self.weight), in_time.shape[1]
        gathered = torch.einsum("vki,dkio->dvo", on_surface[self.spirals], self.weight)
        moved = torch.zeros(*in_time.shape[:2], self.weight.shape[-1], dtype=in_time.dtype)
        for d in range(delta):
            behind = delta - 1 - d
            moved[:, behind:] += in_time[:, : frames - behind] @ self.weight[d].sum(dim=0)
        in_range = torch.arange(frames)[:, None] >= torch.arange(delta - 1, -1, -1)
        return moved[:, :, None] + torch.einsum("td,dvo->tvo", in_range.to(gathered), gathered) + self.bias
