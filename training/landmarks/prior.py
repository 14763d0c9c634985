"""The shape prior of the 68 landmarks: how they vary together over the training faces.

A similarity brings every face to the mean landmarks (weights as in `mesh/canonical.rs`). The leading modes of
the remaining differences, scaled to their standard deviation, go into the model file.
"""

from pathlib import Path

import numpy as np

from training.align import canonical_landmarks, similarity, stability
from training.corpus.mirror import permutation
from training.landmarks import pool, samples
from training.landmarks.characters import character
from training.landmarks.covers import covered
from training.landmarks.stylise import stylise

MODES = 48


def aligned(landmarks: np.ndarray) -> np.ndarray:
    """Landmarks `[68, 3]`, aligned to the mean landmarks."""
    return similarity(landmarks, canonical_landmarks(), stability())(landmarks)


def only_landmarks(faces: samples.Faces) -> samples.Faces:
    """Reduces both face models to the landmarks' vertices, because the surface does not matter here."""
    ict_vertices, makehuman_vertices = faces.landmarks, faces.mh_landmarks
    faces.neutral = faces.neutral[ict_vertices]
    faces.identity = faces.identity.reshape(len(faces.identity), -1, 3)[:, ict_vertices].reshape(-1, 204)
    faces.expression = faces.expression.reshape(len(faces.expression), -1, 3)[:, ict_vertices].reshape(
        -1, 204
    )
    faces.mh_points, faces.mh_deltas = (
        faces.mh_points[makehuman_vertices],
        faces.mh_deltas[:, makehuman_vertices],
    )
    faces.landmarks = faces.mh_landmarks = np.arange(68)
    faces.triangles = faces.mh_triangles = np.array([[0, 1, 2]], np.int32)
    return faces


def shapes(data: Path, count: int, seed: int) -> np.ndarray:
    """`[count, 204]` landmarks minus the mean landmarks. Three in four heads are warped.

    Three in ten are stylised people, three in ten are of clay, and the others are plain people. One in seven
    has covered eyes.
    """
    faces, chosen = only_landmarks(samples.Faces(data)), pool.identities(held_out=False)
    out = np.empty((count, 204))
    for i in range(count):
        rng = np.random.default_rng([seed, 3, i])
        is_makehuman = rng.random() < pool.MAKEHUMAN_SHARE
        head = (
            faces.makehuman_head(rng)
            if is_makehuman
            else faces.ict_head(rng, chosen[rng.integers(len(chosen))])
        )
        styled = rng.random()
        if styled < 0.3:
            head = stylise(rng, head)
        elif styled < 0.6:
            head = character(rng)
        if rng.random() < 0.15:
            head = covered(rng, head)
        if rng.random() < 0.75:
            head = samples.warp(rng, head, rng.choice([0.5, 1.0, 2.0]))
        out[i] = (aligned(head.landmarks) - canonical_landmarks()).ravel()
    return out


def modes(data: Path, count: int = 4000, seed: int = 0) -> np.ndarray:
    """Modes `[MODES, 204]`, metres, each as long as its standard deviation. Both mirror images count."""
    x = shapes(data, count, seed)
    flipped = x.reshape(-1, 68, 3)[:, permutation()] * [-1.0, 1.0, 1.0]
    both = np.concatenate([x, flipped.reshape(-1, 204)])
    _, s, vt = np.linalg.svd(both / np.sqrt(len(both)), full_matrices=False)
    print(f"the first {MODES} modes hold {(s[:MODES] ** 2).sum() / (s**2).sum():.4f} of the variance")
    return s[:MODES, None] * vt[:MODES]
