"""Random heads with known landmarks: ICT identities and MakeHuman, warped, cut, remeshed, dressed.

Every sample is a mesh in canonical metres (upright, facing +z, before random rotation), with the
68 true landmarks. `pool.py` renders them.
"""

from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np
from safetensors.numpy import load_file

from training.align import canonical_landmarks
from training.landmarks import canonical

# ICT parts by first and last vertex; the safetensors metadata names them.
FACE, HEAD_AND_NECK = (0, 9408), (9409, 11247)
INSIDES = [(11248, 13293), (13294, 14061), (14062, 21450)]
EYES = (21451, 24590)
EYE_DETAILS = (24591, 26718)
SUBTLE = [
    "jawOpen", "mouthSmile_L", "mouthSmile_R", "mouthFunnel", "mouthPucker", "mouthFrown_L", "mouthFrown_R",
    "browInnerUp_L", "browInnerUp_R", "browDown_L", "browDown_R", "eyeWide_L", "eyeWide_R", "eyeBlink_L",
    "eyeBlink_R", "mouthClose", "mouthLeft", "mouthRollLower",
]  # fmt: skip


@dataclass
class Head:
    """`points` `[V, 3]` metres, `triangles` `[F, 3]`, `landmarks` `[68, 3]` metres."""

    points: np.ndarray
    triangles: np.ndarray
    landmarks: np.ndarray


class Faces:
    """The two face models, loaded once."""

    def __init__(self, data: Path):
        import json

        from safetensors import safe_open

        ict = load_file(data / "faces/ict_facekit.safetensors")
        with safe_open(data / "faces/ict_facekit.safetensors", "np") as file:
            names = json.loads(file.metadata()["expression_names"])
        self.neutral = canonical.from_ict(ict["neutral"]).astype(np.float32)
        self.identity = (ict["identity"].astype(np.float32) * 0.01).reshape(100, -1)
        indices = [names.index(n) for n in SUBTLE]
        self.expression = (ict["expression"][indices].astype(np.float32) * 0.01).reshape(len(indices), -1)
        self.triangles = ict["triangles"].astype(np.int32)
        self.landmarks = ict["landmarks68"].astype(np.int64)
        makehuman = load_file(data / "faces/makehuman_head.safetensors")
        self.mh_points, self.mh_triangles = (
            makehuman["neutral"] * 0.1,
            makehuman["triangles"].astype(np.int32),
        )
        self.mh_landmarks = makehuman["landmarks68"].astype(np.int64)
        self.mh_deltas = makehuman["deltas"].astype(np.float32) * 0.1
        self._centre_makehuman()

    def _centre_makehuman(self) -> None:
        """Moves MakeHuman's head onto the mean ICT head, so that noses and eyes coincide on average."""
        steady = list(range(27, 48))
        here = self.mh_points[self.mh_landmarks][steady].mean(0)
        there = canonical_landmarks()[steady].mean(0)
        self.mh_points = (self.mh_points + (there - here)).astype(np.float32)

    def ict_head(self, rng: np.random.Generator, coefficients: np.ndarray) -> Head:
        """An identity with a slight expression and a random choice of parts."""
        points = self.neutral + (coefficients @ self.identity).reshape(-1, 3)
        weights = rng.random(len(SUBTLE)) * (rng.random(len(SUBTLE)) < 0.15) * 0.5
        points = points + (weights.astype(np.float32) @ self.expression).reshape(-1, 3)
        keep = np.zeros(len(points), bool)
        keep[FACE[0] : FACE[1] + 1] = True
        keep[HEAD_AND_NECK[0] : HEAD_AND_NECK[1] + 1] = rng.random() < 0.85
        for first, last in INSIDES:
            keep[first : last + 1] = rng.random() < 0.7
        keep[EYES[0] : EYES[1] + 1] = rng.random() < 0.75
        keep[EYE_DETAILS[0] : EYE_DETAILS[1] + 1] = rng.random() < 0.4
        triangles = self.triangles[keep[self.triangles].all(1)]
        return Head(points, triangles, points[self.landmarks])

    def makehuman_head(self, rng: np.random.Generator) -> Head:
        """MakeHuman with a slight expression."""
        weights = rng.random(len(self.mh_deltas)) * (rng.random(len(self.mh_deltas)) < 0.06) * 0.5
        points = self.mh_points + np.tensordot(weights.astype(np.float32), self.mh_deltas, 1)
        return Head(points, self.mh_triangles, points[self.mh_landmarks])


def warp(rng: np.random.Generator, head: Head, strength: float) -> Head:
    """Smooth random bumps and stretches, the same for the surface and its landmarks."""
    stretch = np.exp(rng.normal(0, 0.10 * strength, 3))
    bumps = [
        (
            rng.uniform([-0.09, -0.12, -0.03], [0.09, 0.10, 0.11]),
            rng.uniform(0.015, 0.07),
            rng.normal(0, 0.006 * strength, 3),
        )
        for _ in range(rng.integers(3, 10))
    ]

    def move(points: np.ndarray) -> np.ndarray:
        out = points.copy()
        for centre, sigma, amplitude in bumps:
            # Limit the amplitude so that the slope stays under one half. Else the bump folds the surface.
            size = np.linalg.norm(amplitude)
            amplitude = amplitude * min(1.0, 0.5 * sigma / max(size, 1e-9))
            d2 = ((points - centre) ** 2).sum(-1, keepdims=True)
            out = out + np.exp(-0.5 * d2 / sigma**2) * amplitude
        return out * stretch

    return Head(move(head.points), head.triangles, move(head.landmarks))


def remesh(rng: np.random.Generator, head: Head, target: float | None = None, gentle: bool = False) -> Head:
    """Another triangulation, decimated to `target` triangles or by a random amount.

    With `gentle`, features last longest.
    """
    reduction = rng.uniform(0.4, 0.93) if target is None else 1 - target / len(head.triangles)
    used = np.unique(head.triangles)
    number = np.full(len(head.points), -1)
    number[used] = np.arange(len(used))
    points, triangles = fast_simplification.simplify(
        head.points[used].astype(np.float32),
        number[head.triangles].astype(np.int32),
        target_reduction=float(np.clip(reduction, 0.0, 0.99)),
        agg=3.0 if gentle else 7.0,
    )
    return Head(points, triangles.astype(np.int32), head.landmarks)


def tear(rng: np.random.Generator, head: Head) -> Head:
    """Cuts off everything behind, below or above a plane, or bites small holes."""
    middle = head.points[head.triangles].mean(1)
    keep = np.ones(len(middle), bool)
    if rng.random() < 0.4:
        keep &= middle[:, 2] > rng.uniform(-0.06, 0.0)
    if rng.random() < 0.3:
        keep &= middle[:, 1] > rng.uniform(-0.17, -0.12)
    if rng.random() < 0.3:
        keep &= middle[:, 1] < rng.uniform(0.05, 0.10)
    for _ in range(rng.integers(0, 3)):
        centre = middle[rng.integers(len(middle))]
        keep &= ((middle - centre) ** 2).sum(1) > rng.uniform(0.004, 0.012) ** 2
    return Head(head.points, head.triangles[keep], head.landmarks)


def ellipsoid(centre, radii, steps: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """A closed ellipsoid, points and triangles."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, 2 * steps), indexing="ij"
    )
    unit = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1)
    columns = 2 * steps
    grid = np.arange(steps * columns).reshape(steps, columns)
    a, b = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel()
    c, d = grid[1:, :-1].ravel(), grid[1:, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    return unit.reshape(-1, 3) * np.asarray(radii) + np.asarray(centre), triangles.astype(np.int32)


def dress(rng: np.random.Generator, head: Head) -> Head:
    """Adds things that other models have: shoulders, a trunk, hair, ears of a hat."""
    extra = []
    if rng.random() < 0.4:
        extra.append(
            ellipsoid(
                [0, rng.uniform(-0.32, -0.22), -0.03], rng.uniform([0.15, 0.06, 0.07], [0.26, 0.10, 0.13])
            )
        )
        if rng.random() < 0.5:
            extra.append(
                ellipsoid(
                    [0, rng.uniform(-0.8, -0.4), -0.03], rng.uniform([0.12, 0.2, 0.07], [0.3, 0.6, 0.16])
                )
            )
    if rng.random() < 0.35:
        radii = rng.uniform([0.08, 0.09, 0.085], [0.12, 0.13, 0.11])
        extra.append(ellipsoid([0, rng.uniform(0.04, 0.09), 0.075 - radii[2] - rng.uniform(0, 0.02)], radii))
    if rng.random() < 0.1:
        for side in (-1, 1):
            extra.append(
                ellipsoid(
                    [side * rng.uniform(0.06, 0.11), rng.uniform(0.02, 0.15), -0.02],
                    rng.uniform([0.02, 0.02, 0.02], [0.05, 0.08, 0.05]),
                )
            )
    points, triangles = [head.points], [head.triangles]
    for more_points, more_triangles in extra:
        triangles.append(more_triangles + sum(map(len, points)))
        points.append(more_points)
    return Head(np.concatenate(points), np.concatenate(triangles), head.landmarks)
