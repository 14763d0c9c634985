"""Random heads for training: human, warped, or strongly stylised; torn, remeshed, dressed."""

import numpy as np

from training.landmarks import render, samples
from training.landmarks.samples import Faces, Head
from training.landmarks.stylise import company, smoothed, stylise

STYLISED = 0.55


def random_head(
    rng: np.random.Generator, faces: Faces, identities: np.ndarray, makehuman_share: float
) -> Head:
    """One head. `identities`: `[n, 100]` coefficients to choose from."""
    made = rng.random() < makehuman_share
    if made:
        head = faces.makehuman_head(rng)
    else:
        head = faces.ict_head(rng, identities[rng.integers(len(identities))])
    styled = rng.random() < STYLISED
    if styled:
        head = stylise(rng, head)
    elif rng.random() < 0.15:
        head = smoothed(head, int(rng.integers(3, 15)))
    if made or styled or rng.random() < 0.75:
        head = samples.warp(rng, head, rng.choice([0.5, 1.0, 2.0]))
    if rng.random() < (0.2 if styled else 0.4):
        head = samples.tear(rng, head)
    if rng.random() < 0.4:
        head = low_poly(rng, head) if styled else samples.remesh(rng, head)
    for _ in range(4):
        dressed = samples.dress(rng, head)
        if styled or rng.random() < 0.25:
            dressed = company(rng, dressed)
        if seen(dressed):
            return dressed
    return head


def seen(head: Head) -> bool:
    """Whether what the head wears leaves its face free, as seen from the front."""
    inner = head.landmarks[17:]
    middle = inner.mean(0)
    half = 1.1 * np.abs(inner - middle)[:, :2].max()
    points, triangles = head.points.astype(np.float32), head.triangles.astype(np.int32)
    buffer = render.depth_buffer(points, triangles, *middle[:2].astype(np.float32), np.float32(half), 64)
    column, row = (render.to_window(inner, middle, half).T * 64).astype(int)
    hidden = buffer[row, column] > inner[:, 2] + 0.015
    return hidden.mean() < 0.35


def low_poly(rng: np.random.Generator, head: Head) -> Head:
    """A triangulation as coarse as game characters have."""
    most = len(head.triangles)
    return samples.remesh(rng, head, target=float(np.exp(rng.uniform(np.log(500), np.log(min(8000, most))))))
