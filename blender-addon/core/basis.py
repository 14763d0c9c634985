"""Displacements as few vectors and their weights, with a stated largest error.

Principal components without a mean, so that zero weights are the face at rest. A vertex that
never moves takes no part. The number of vectors is the smallest whose largest error, over all
vertices and frames, is at most the one asked for.
"""

import numpy as np

from .take import Basis

# Up to this many frames the components come from all coordinates.
_EXACT_FRAMES = 256
# For longer takes the course of so many coordinates spans all motion: static weights over 68
# landmarks give a rank of 204 at most. If that is not enough, all coordinates are taken.
_SAMPLED = 768
# The number of vectors is first sought on so many vertices.
_PROBED = 1500


def compress(displacements: np.ndarray, mm_per_unit: float, error_mm: float) -> Basis:
    """The basis of `displacements` `[T, V, 3]` with at most `error_mm` anywhere.

    Cost: a few products of `[T, 3V]` with narrow matrices. The returned `error_mm` is measured.
    """
    frames, vertices, _ = displacements.shape
    limit = error_mm / mm_per_unit
    moving = _moving(displacements)
    part = displacements if len(moving) == vertices else displacements[:, moving]
    flat = part.reshape(frames, -1)
    weights, vectors, error = _fit(flat, limit)
    peak = np.abs(weights).max(axis=0)
    full = np.zeros((len(vectors), vertices, 3), dtype=np.float32)
    full[:, moving] = (vectors * peak[:, None]).reshape(len(vectors), -1, 3)
    return Basis(full, weights / peak, error * mm_per_unit)


def _moving(displacements: np.ndarray) -> np.ndarray:
    """Numbers of the vertices that move in any frame."""
    moves = np.zeros(displacements.shape[1], dtype=bool)
    for frame in displacements:
        moves |= frame.any(axis=1)
    return np.flatnonzero(moves)


def _fit(flat: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Weights `[T, K]`, vectors `[K, N]` and their largest error for `flat` `[T, N]`."""
    if len(flat) > _EXACT_FRAMES:
        weights, vectors = _components(flat, _courses(flat, limit))
        count, error = _smallest(flat, weights, vectors, limit)
        if error <= limit:
            return weights[:, :count], vectors[:count], error
    weights, vectors = _components(flat, np.eye(len(flat), dtype=np.float32))
    count, error = _smallest(flat, weights, vectors, limit)
    return weights[:, :count], vectors[:count], error


def _courses(flat: np.ndarray, limit: float) -> np.ndarray:
    """Orthonormal courses over time `[T, R]` that span those of a sample of coordinates."""
    chosen = np.linspace(0, flat.shape[1] - 1, min(_SAMPLED, flat.shape[1])).astype(int)
    sample = flat[:, chosen].astype(np.float64)
    values, modes = np.linalg.eigh(sample.T @ sample)
    values, modes = values[::-1].clip(min=0.0), modes[:, ::-1]
    # What is left out may reach a hundredth of the limit in the mean.
    rest = np.sqrt(np.cumsum(values[::-1])[::-1] / sample.size)
    kept = (rest > limit * 0.01) & (values > values[0] * 1e-12)
    kept[0] = True
    courses, _ = np.linalg.qr(sample @ modes[:, kept])
    return courses.astype(np.float32)


def _components(flat: np.ndarray, courses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal weights `[T, K]` and vectors `[K, N]` within `courses`, largest first."""
    rows = courses.T @ flat if courses.shape[1] < len(flat) else flat
    values, turn = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    values, turn = values[::-1], turn[:, ::-1]
    # Below this share of the largest value float32 products hold nothing but rounding.
    turn = turn[:, values > values[0] * 1e-9].astype(np.float32)
    return courses @ turn, turn.T @ rows


def _smallest(flat, weights, vectors, limit: float) -> tuple[int, float]:
    """The smallest number of vectors with an error of at most `limit`, and that error."""
    step = max(1, flat.shape[1] // 3 // _PROBED)
    probe = flat.reshape(len(flat), -1, 3)[:, ::step].reshape(len(flat), -1)
    probed = vectors.reshape(len(vectors), -1, 3)[:, ::step].reshape(len(vectors), -1)
    low, high = 1, len(vectors)
    while low < high:
        middle = (low + high) // 2
        if _largest_error(probe, weights, probed, middle) <= limit:
            high = middle
        else:
            low = middle + 1
    # The probe missed at most a few vertices: usually this takes one or two rounds.
    for count in range(low, len(vectors) + 1):
        error = _largest_error(flat, weights, vectors, count)
        if error <= limit:
            break
    return count, error


def _largest_error(flat, weights, vectors, count: int) -> float:
    """Largest distance of a vertex from its place with `count` vectors, in the units of `flat`."""
    worst = 0.0
    for start in range(0, len(flat), 64):
        rows = slice(start, start + 64)
        rest = flat[rows] - weights[rows, :count] @ vectors[:count]
        rest = rest.reshape(len(rest), -1, 3)
        worst = max(worst, float(np.einsum("tvc,tvc->tv", rest, rest).max()))
    return worst**0.5
