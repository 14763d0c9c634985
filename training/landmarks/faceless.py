"""Shapes without a face, for training: blobs, hand-like stars, mirrored assemblies of parts, bodies
without a head, and heads without features.

Other code (`faceless_unseen.py`) makes the things that measure how well the finder refuses.
"""

import numpy as np

from training.landmarks import adorn, samples
from training.landmarks.characters import clay_of
from training.landmarks.samples import Head, ellipsoid
from training.landmarks.stylise import body, company, limb


def joined(parts: list) -> Head:
    """Joins several shapes into one mesh. Its landmarks mean nothing."""
    starts = np.cumsum([0] + [len(p) for p, _ in parts])
    triangles = [t + start for (_, t), start in zip(parts, starts, strict=False)]
    return Head(np.concatenate([p for p, _ in parts]), np.concatenate(triangles), np.zeros((68, 3)))


def blobs(rng: np.random.Generator) -> Head:
    """Ellipsoids and hand-like stars of limbs, warped."""
    parts = [
        ellipsoid(rng.normal(0, 0.05, 3), rng.uniform(0.02, 0.12, 3), int(rng.integers(4, 16)))
        for _ in range(rng.integers(1, 6))
    ]
    if rng.random() < 0.5:
        for _ in range(rng.integers(2, 7)):
            tip = rng.normal(size=3) * 0.1
            parts.append(limb(rng, rng.normal(0, 0.02, 3), tip, rng.uniform(0.006, 0.03)))
    return samples.warp(rng, joined(parts), 2.0)


def part(rng: np.random.Generator, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An ellipsoid, a box, a bar or a ring."""
    kind, size = rng.integers(4), rng.uniform(0.006, 0.08, 3)
    if kind == 0:
        return ellipsoid(centre, size, int(rng.integers(4, 14)))
    if kind == 1:
        return adorn.box(centre, size)
    if kind == 2:
        return limb(rng, centre, centre + rng.normal(0, 0.06, 3), rng.uniform(0.004, 0.03))
    points, triangles = adorn.tube(adorn.ring([0, 0, 0], *size[:2]), 0.3 * size[2], True)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
    return points @ axes + centre, triangles


def assembly(rng: np.random.Generator) -> Head:
    """Parts on a plane and mirrored pairs beside it, as in furniture, tools and machines."""
    parts = [part(rng, np.array([0, *rng.normal(0, 0.06, 2)])) for _ in range(rng.integers(1, 4))]
    for _ in range(rng.integers(0, 4)):
        points, triangles = part(rng, rng.normal(0, 0.07, 3))
        parts += [(points, triangles), (points * [-1, 1, 1], triangles)]
    return joined(parts)


def headless(rng: np.random.Generator) -> Head:
    """A body on two or four legs that ends at the neck."""
    trunk = body(rng, four_legs=rng.random() < 0.4)
    return joined([*trunk, limb(rng, [0, -0.12, -0.03], [0, -0.05, -0.03], 0.04)])


def featureless(rng: np.random.Generator) -> Head:
    """A ball, an egg or a box with ears, horns, a hat or a body, and at most one thing on its front."""
    clay = clay_of(rng)
    points, triangles = clay.bare()
    parts = [(clay.raised(points), triangles)]
    if rng.random() < 0.4:
        parts.append(part(rng, np.array([*rng.normal(0, 0.03, 2), 0.08])))
    head = joined(parts)
    head.landmarks[0, 0] = 0.075
    return company(rng, adorn.side_ears(rng, head) if rng.random() < 0.4 else head)


def faceless(rng: np.random.Generator) -> Head:
    """One of the above."""
    make = [blobs, assembly, headless, featureless][rng.choice(4, p=[0.35, 0.35, 0.1, 0.2])]
    return make(rng)
