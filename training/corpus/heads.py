"""Whole heads and the space around them: ICT identities with face, head, neck and sockets.

The skin with its sockets is one closed surface except for the neck's end, which a fan of triangles closes.
All identities share its triangles, so a place on (or beside) the mean head has a partner on every other one.
Places off the surface lie along its normals. Places of the volume are drawn once around the mean head, where
the winding number tells inside from outside. Nearby vertices carry them along to other identities.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from scipy.spatial import cKDTree
from torch import Tensor

from training.align import canonical_landmarks, similarity, stability
from training.corpus.faces import CHANNELS, load_ict

COEFFICIENTS = 100
FACE_VERTICES = 9409
BOX_M = 0.12
"""The box in which far points are drawn reaches this many metres beyond the head on every side."""
SPREAD_M, FURTHEST_M = 2e-3, 6e-3
"""Standard deviation and bound of the distance at which places are drawn beside the surface."""
UNTOUCHED_M = 1e-4
"""A place is dropped if another part of the surface is nearer than its own by more than this.

The bound grows by 2 % of the distance from its own part.
"""
ON_SURFACE = 0.4
FACE_SHARE, FEATURE_SHARE, FEATURE_M, LIP_SHARE = 2.0, 8.0, 8e-3, 12.0
"""A triangle is drawn in proportion to its area times 1 plus these shares.

`FACE_SHARE` counts for the face, `FEATURE_SHARE` near landmarks of brows, eyes, nose and mouth, and
`LIP_SHARE` near the lips. The last two fall off as a Gaussian, to 1/e at `FEATURE_M` metres.
"""
CHUNK = 100
UNCLEAR = 0.3
"""A point lies on the surface and is dropped if its winding number is this near to 0.5."""
CARRIERS, CARRIER_M = 40, 4e-3
DENSE = 1_500_000
VERSION = 3


@dataclass
class Places:
    """Places on and beside the mean head: triangle numbers [P], shares of corners [P, 3], and the distance
    along the normal [P] in metres."""

    triangle: Tensor
    share: Tensor
    away: Tensor

    def __getitem__(self, rows: Tensor) -> Places:
        return Places(self.triangle[rows], self.share[rows], self.away[rows])

    def __len__(self) -> int:
        return len(self.triangle)


@dataclass
class Volume:
    """Places around the mean head: points [R, 3], signed distance [R] (negative inside), the vertices [R, K]
    that carry each of them, and their shares."""

    points: Tensor
    distance: Tensor
    carriers: Tensor
    share: Tensor


class IctHeads:
    """ICT's identities in the canonical pose, jaw open by `open_jaw`, aligned to the canonical frame."""

    def __init__(self, data: Path, cache: Path, open_jaw: float, places: int = 400_000, volume: int = 90_000):
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
        self.steady = torch.from_numpy(stability()).float()
        self.opened = self.mean + self.modes[CHANNELS.index("jawOpen")] * open_jaw
        self.normals = vertex_normals(self.opened[None], self.triangles)[0]
        path = cache / f"ict_places_{VERSION}_{places}_{volume}_{open_jaw}.pt"
        if not path.exists():
            cache.mkdir(parents=True, exist_ok=True)
            torch.save(self._drawn(places, volume), path)
        tables = torch.load(path)
        self.places, self.volume = Places(**tables["places"]), Volume(**tables["volume"])

    def _drawn(self, places: int, volume: int) -> dict[str, dict[str, Tensor]]:
        random = torch.Generator().manual_seed(5)
        corners = self.opened[self.triangles]
        area = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(
            dim=1
        )
        dense = drawn_places(area, DENSE, random)
        surface = self.at(self.opened[None], self.normals[None], dense)[0]
        tree = cKDTree(surface.numpy())
        chance = area * self.attention()
        candidates = drawn_places(chance, 3 * places, random)
        step = SPREAD_M * torch.randn(len(candidates), generator=random).clamp(-3.0, 3.0)
        step[torch.rand(len(candidates), generator=random) < ON_SURFACE] = 0.0
        candidates.away = step.clamp(-FURTHEST_M, FURTHEST_M)
        points = self.at(self.opened[None], self.normals[None], candidates)[0]
        nearest = torch.from_numpy(tree.query(points.numpy())[0]).float()
        clear = (nearest - candidates.away.abs()).abs() < UNTOUCHED_M + 0.02 * candidates.away.abs()
        candidates = candidates[(clear | (candidates.away == 0.0)).nonzero()[:, 0][:places]]
        points, inside = volume_points(self.opened.numpy(), self.triangles.numpy(), volume)
        distance = torch.from_numpy(tree.query(points)[0]).float()
        far, carriers = (torch.from_numpy(x) for x in cKDTree(self.opened.numpy()).query(points, k=CARRIERS))
        share = torch.exp(-((far - far[:, :1]) / (CARRIER_M + 0.3 * far[:, :1])).square())
        return {
            "places": vars(candidates),
            "volume": {
                "points": torch.from_numpy(points),
                "distance": torch.where(torch.from_numpy(inside), -distance, distance),
                "carriers": carriers,
                "share": (share / share.sum(1, keepdim=True)).float(),
            },
        }

    def attention(self) -> Tensor:
        """How often each triangle is drawn relative to its area, [F]."""
        centre = self.opened[self.triangles].mean(1)
        face = (self.triangles < FACE_VERTICES).all(1).float()
        features = torch.cdist(centre, self.opened[self.landmarks[17:]]).amin(1)
        lips = torch.cdist(centre, self.opened[self.landmarks[48:]]).amin(1)
        near = torch.exp(-(features / FEATURE_M).square()) * FEATURE_SHARE
        return 1.0 + FACE_SHARE * face + near + torch.exp(-(lips / FEATURE_M).square()) * LIP_SHARE

    def at(self, vertices: Tensor, normals: Tensor, places: Places) -> Tensor:
        """Positions [B, P, 3] of places [P] on heads with vertices and normals [B, V, 3]."""
        return self.on(vertices, places) + places.away[:, None] * self.normal(normals, places)

    def on(self, vertices: Tensor, places: Places) -> Tensor:
        """Points [B, P, 3] on the surface below places. Also interpolates other fields [B, V, 3] there."""
        corners = self.triangles[places.triangle]
        return sum(places.share[:, i, None] * vertices[:, corners[:, i]] for i in range(3))

    def normal(self, normals: Tensor, places: Places) -> Tensor:
        """Unit normals [B, P, 3]."""
        return F.normalize(self.on(normals, places), dim=-1)

    def carried(self, moves: Tensor, rows: Tensor) -> Tensor:
        """Motion [B, R, 3] of the places `rows` [R] of the volume when vertices move by [B, V, 3]."""
        carriers, share = self.volume.carriers[rows], self.volume.share[rows]
        return torch.einsum("brkc,rk->brc", moves[:, carriers], share)

    def canonical(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """Vertices [B, V, 3] in the canonical pose and the scale of each head [B]."""
        people, scales = self.people(coefficients)
        return self.posed(people, scales, self.rest.expand(len(people), -1)), scales

    def people(self, coefficients: Tensor) -> tuple[Tensor, Tensor]:
        """Coefficients [B, 100] → vertices at rest, mouth closed, [B, V, 3] and the scale of each [B]."""
        at = self.mean + (coefficients @ self.identity).unflatten(1, (-1, 3))
        fits = [similarity(head[self.landmarks], self.goal, self.steady) for head in at]
        people = torch.stack([fit(head) for fit, head in zip(fits, at, strict=True)])
        return people, torch.stack([fit.scale for fit in fits])

    def posed(self, people: Tensor, scales: Tensor, weights: Tensor) -> Tensor:
        """Vertices [B, V, 3] of heads at rest that ARKit weights [B, M] move."""
        moved = (weights @ self.modes.flatten(1)).unflatten(1, (-1, 3))
        return people + scales[:, None, None] * moved


def drawn_places(chance: Tensor, count: int, random: torch.Generator) -> Places:
    """Draws `count` places on the surface, with triangles in proportion to `chance` [F]."""
    triangle = torch.multinomial(chance, count, replacement=True, generator=random)
    share = torch.rand(count, 2, generator=random)
    over = share.sum(1) > 1.0
    share[over] = 1.0 - share[over]
    return Places(triangle, torch.cat([1.0 - share.sum(1, keepdim=True), share], 1), torch.zeros(count))


def vertex_normals(vertices: Tensor, triangles: Tensor) -> Tensor:
    """Unit normals [B, V, 3], triangles weighted by area."""
    a, b, c = (vertices[:, triangles[:, i]] for i in range(3))
    cross = torch.linalg.cross(b - a, c - a)
    total = torch.zeros_like(vertices)
    for i in range(3):
        total.index_add_(1, triangles[:, i], cross)
    return F.normalize(total, dim=-1)


def neck_rim(triangles: np.ndarray) -> np.ndarray:
    """Edges [E, 2] that belong to only one triangle, in that triangle's direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, count = np.unique(np.sort(edges, 1), axis=0, return_index=True, return_counts=True)
    return edges[first[count == 1]]


def volume_points(vertices: np.ndarray, triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points around a closed head, at most [count, 3], and whether each lies inside.

    Half are drawn anywhere, half near the surface. Points whose winding number is unclear are dropped.
    """
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
    """How often a closed mesh winds round each point [P] (Jacobson et al. 2013).

    Every triangle is a dipole at its centre (Barill et al. 2018). This is accurate to a few hundredths for
    points farther away than a triangle's size.
    """
    corners = torch.from_numpy(vertices[triangles]).float()
    centre = corners.mean(1)
    area = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    offset = (area * centre).sum(1)
    windings = []
    for chunk in torch.from_numpy(points).float().split(CHUNK):
        above = offset - chunk @ area.T
        below = torch.cdist(chunk, centre).clamp_min(1e-4)
        windings.append((above / (below * below * below)).sum(1) / (4.0 * np.pi))
    return torch.cat(windings).numpy()
