"""What the template's skin does between the landmarks, and how that is read off its motion.

The engine hands on the template's 68 landmarks, which the static weights and the creases spread over a mesh.
What these leave over of the 51 shapes on the template itself is a motion of its vertices that no landmark
tells of, such as puffed cheeks; K shapes span it. `read` finds their weights in the motion of the template's
first vertices, which lie as far from one another as they can (`template.chosen`).

Lips and lids are left to the landmarks. Shapes: `V` vertices, `M` = 51 channels, `R` vertices that are read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from training.corpus.faces import CHANNELS, load_ict
from training.corpus.prepared import prepare
from training.fit_creases import read_creases, read_static, residual

SHAPES, READ = 24, 700
NOISE_DM = 0.01
"""By which a network's motion is off, standard deviation; keeps `read` small."""
FULL_FROM_DM, NONE_WITHIN_DM = 0.09, 0.03
"""Distances from the landmarks of lips and lids."""
SAME_M = 1e-6
INSIDE_DM = 0.1
"""What lies as near to the mouth's middle is inside it."""
CHEEKS, CHEEKS_WEIGHT = ("cheekPuff", "cheekSquintLeft", "cheekSquintRight"), 2.0
"""Landmarks say least of them, so that they count for more where shapes are chosen."""


def share(positions: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """1 where the skin is followed, 0 at lips and lids. [V, 3], [68, 3] dm → [V]."""
    rims = np.linalg.norm(positions[:, None] - landmarks[36:60], axis=2).min(axis=1)
    inside = np.linalg.norm(positions - landmarks[48:].mean(axis=0), axis=1) < INSIDE_DM
    return ((rims - NONE_WITHIN_DM) / (FULL_FROM_DM - NONE_WITHIN_DM)).clip(0.0, 1.0) * ~inside


def between(data: Path, models: Path, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`shapes` [V, 3, K], 1 where each moves most, and `read` [K, 3 R]: metres of the first vertices to
    weights in metres. `models` holds the static weights and the creases; `vertices` [V, 3] are ICT's own."""
    face = load_ict(data, "face").mean
    away, chosen = cKDTree(face.vertices).query(vertices)
    if away.max() > SAME_M:
        raise ValueError(
            f"template: expected vertices of ICT's face, got one {away.max():.1e} m from all of them"
        )
    mesh = prepare(face)
    positions, landmarks = (
        x.numpy().astype(np.float64) for x in (mesh.geometry.positions, mesh.geometry.landmarks)
    )
    creases = read_creases(models, "ict")
    cross = creases.transferred(positions, mesh.triangles, landmarks)
    moved = mesh.modes[:, mesh.landmarks].flatten(1).numpy()
    left = residual(read_static(models), mesh) - np.einsum(
        "vxk,kc,mc->mvx", cross, creases.motion, moved, optimize=True
    )
    left = (left * share(positions, landmarks)[:, None])[:, chosen].reshape(len(CHANNELS), -1)
    weight = np.where(np.isin(CHANNELS, CHEEKS), CHEEKS_WEIGHT, 1.0)
    _, _, shapes = np.linalg.svd(weight[:, None] * left, full_matrices=False)
    shapes = shapes[:SHAPES].reshape(SHAPES, -1, 3)
    shapes /= np.linalg.norm(shapes, axis=2).max(axis=1)[:, None, None]
    flat = shapes.reshape(SHAPES, -1)
    weights = np.linalg.solve(flat @ flat.T, flat @ left.T)
    seen = mesh.modes.numpy()[:, chosen[:READ]].reshape(len(CHANNELS), -1).astype(np.float64)
    channels = np.linalg.solve(seen @ seen.T + NOISE_DM**2 * np.eye(len(seen)), seen)
    return shapes.transpose(1, 2, 0), weights @ channels
