"""Heads with all that lies about them: ICT identities, face, head and neck, with sockets, the neck capped.

The skin with its sockets is one closed surface but for the neck's end, which a fan of triangles closes.
Points of the volume are drawn once about the mean head in its canonical pose, where the winding number
tells inside from outside, and follow the surface nearby to every other identity; points near the surface
lie on normals.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from training.corpus.faces import CHANNELS, canonical_landmarks, load_ict, stability

COEFFICIENTS = 100
BOX_M = 0.06
"""How far about the head the far points lie."""
NEAR_M = 5e-3
CHUNK = 100
UNCLEAR = 0.3
"""Points whose winding number is nearer to 0.5 are left out: they lie on the surface."""


@dataclass
class Batch:
    """Points of `B` heads in metres. surface, normals [B, P, 3]; near [B, P, 3] with its distance [B, P];
    far [B, R, 3] with its sign [B, R]; landmarks [B, 68, 3]; coefficients [B, 100]."""

    coefficients: Tensor
    landmarks: Tensor
    surface: Tensor
    normals: Tensor
    near: Tensor
    near_distance: Tensor
    far: Tensor
    far_sign: Tensor


class IctHeads:
    """ICT's identities in the canonical pose, jaw open by `open_jaw`, aligned to the canonical frame."""

    def __init__(self, data: Path, cache: Path, open_jaw: float, volume: int = 12000):
        model = load_ict(data, "skin")
        mean = model.mean
        rim = neck_rim(mean.triangles)
        top = len(mean.vertices)
        cap = np.stack([rim[:, 1], rim[:, 0], np.full(len(rim), top)], 1)
        self.triangles = torch.from_numpy(np.concatenate([mean.triangles, cap]))
        ends = np.unique(rim)

        def closed(x: np.ndarray) -> Tensor:
            return torch.from_numpy(np.concatenate([x, x[..., ends, :].mean(-2, keepdims=True)], -2)).float()

        self.mean, self.modes = closed(mean.vertices), closed(mean.modes)
        self.identity = closed(model.identity).flatten(1)
        self.landmarks = torch.from_numpy(mean.landmarks)
        self.open_jaw = open_jaw
        self.rest = torch.zeros(len(CHANNELS))
        self.rest[CHANNELS.index("jawOpen")] = open_jaw
        self.goal = torch.from_numpy(canonical_landmarks()).float()
        self.steady = torch.from_numpy(stability() / stability().sum()).float()[:, None]
        opened = self.mean + self.modes[CHANNELS.index("jawOpen")] * open_jaw
        self.opened = opened
        kept = cache / f"ict_volume_{volume}_{open_jaw}.npz"
        if not kept.exists():
            cache.mkdir(parents=True, exist_ok=True)
            points, inside = volume_points(opened.numpy(), self.triangles.numpy(), volume)
            np.savez(kept, points=points, inside=inside)
        with np.load(kept) as file:
            self.points, inside = torch.from_numpy(file["points"]), torch.from_numpy(file["inside"])
        self.sign = 1.0 - 2.0 * inside.float()
        found = cKDTree(opened.numpy()).query(self.points.numpy(), k=6)
        distance, self.near = (torch.from_numpy(x) for x in found)
        share = 1.0 / (distance + 3e-3).square()
        self.share = (share / share.sum(1, keepdim=True)).float()

    def people(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """Coefficients [B, 100] → vertices at rest, mouth closed, [B, V, 3] and the scale of each [B]."""
        at = self.mean + (coefficients @ self.identity).unflatten(1, (-1, 3))
        scales = []
        for head in at:
            source = head[self.landmarks]
            centre, goal = (self.steady * source).sum(0), (self.steady * self.goal).sum(0)
            u, s, vt = torch.linalg.svd((self.steady * (self.goal - goal)).T @ (source - centre))
            flip = torch.tensor([1.0, 1.0, float(torch.sign(torch.linalg.det(u @ vt)))])
            turn = (u * flip) @ vt
            scale = (s * flip).sum() / (self.steady * (source - centre).square()).sum()
            head.copy_(scale * (head - centre) @ turn.T + goal)
            scales.append(scale)
        return at, torch.stack(scales)

    def posed(self, people: Tensor, scales: Tensor, weights: Tensor) -> Tensor:
        """Heads at rest moved by ARKit weights [B, M], [B, V, 3]."""
        moved = (weights @ self.modes.flatten(1)).unflatten(1, (-1, 3))
        return people + scales[:, None, None] * moved

    def batch(self, coefficients: Tensor, points: int, far: int, random: torch.Generator) -> Batch:
        """Points of the heads of `coefficients`, drawn by area on the surface."""
        people, scales = self.people(coefficients)
        heads = self.posed(people, scales, self.rest.expand(len(people), -1))
        count = len(heads)
        corner = heads[:, self.triangles]
        cross = torch.linalg.cross(corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0])
        area = cross.norm(dim=-1)
        chance = area + area.mean() * self.attention[None]
        chosen = torch.multinomial(chance, points, replacement=True, generator=random)
        rows = torch.arange(count)[:, None]
        shares = torch.rand(count, points, 2, generator=random)
        over = shares.sum(-1) > 1.0
        shares[over] = 1.0 - shares[over]
        picked = corner[rows, chosen]
        surface = picked[:, :, 0] + (shares[..., None] * (picked[:, :, 1:] - picked[:, :, :1])).sum(2)
        normals = torch.nn.functional.normalize(cross[rows, chosen], dim=-1)
        step = torch.randn(count, points, generator=random) * 1.2e-3
        step = step.clamp(-NEAR_M, NEAR_M)
        some = torch.randint(0, len(self.points), (far,), generator=random)
        move = (heads - self.opened)[:, self.near[some]]
        away = self.points[some] + (self.share[some][..., None] * move).sum(2)
        return Batch(coefficients, heads[:, self.landmarks], surface, normals,
                     surface + step[..., None] * normals, step, away,
                     self.sign[some].expand(count, -1))  # fmt: skip

    @property
    def attention(self) -> Tensor:
        """Triangles of the face, [F], that are drawn more often than by area: its features are small."""
        if not hasattr(self, "_attention"):
            self._attention = (self.triangles < 9409).all(1).float()
        return self._attention


def neck_rim(triangles: np.ndarray) -> np.ndarray:
    """Edges [E, 2] of one triangle alone, as that triangle runs through them."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, count = np.unique(np.sort(edges, 1), axis=0, return_index=True, return_counts=True)
    return edges[first[count == 1]]


def volume_points(vertices: np.ndarray, triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points [count, 3] about a closed head and which lie inside: half anywhere, half near the surface."""
    rng = np.random.default_rng(5)
    low, high = vertices.min(0) - BOX_M, vertices.max(0) + BOX_M
    anywhere = rng.uniform(low, high, (count // 2, 3))
    beside = vertices[rng.integers(0, len(vertices), count - count // 2)]
    beside = beside + rng.normal(0.0, 0.01, beside.shape)
    points = np.concatenate([anywhere, beside]).astype(np.float32)
    winding = winding_number(points, vertices, triangles)
    clear = np.abs(winding - 0.5) > UNCLEAR
    return points[clear], winding[clear] > 0.5


def winding_number(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """How often a closed mesh goes round each point [P] (Jacobson et al. 2013), every triangle a dipole at
    its centre (Barill et al. 2018): good to a few hundredths farther off than a triangle's size."""
    corners = torch.from_numpy(vertices[triangles]).float()
    centre = corners.mean(1)
    area = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offset = (area * centre).sum(1)
    found = []
    for chunk in torch.from_numpy(points).float().split(CHUNK):
        above = offset - chunk @ area.T
        below = torch.cdist(chunk, centre).clamp_min(1e-4)
        found.append((above / (below * below * below)).sum(1) / (4.0 * np.pi))
    return torch.cat(found).numpy()
