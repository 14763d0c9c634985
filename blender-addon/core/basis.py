"""Displacements as few vectors and their weights, with a stated largest error.

Principal components without a mean, so that zero weights are the face at rest. A vertex that
never moves takes no part. The number of vectors is the smallest whose largest error, over all
vertices and frames, is at most the one asked for.
"""

import numpy as np

from .take import Basis

# Motion spread by static weights over 68 landmarks has rank 204 at most.
MAX_VECTORS = 224


def compress(displacements: np.ndarray, mm_per_unit: float, error_mm: float) -> Basis:
    """The basis of `displacements` `[T, V, 3]` with at most `error_mm` anywhere.

    Cost: one product of `[T, 3V]` with its transpose, one eigenvalue problem of size `T` and a
    few reconstructions. Motion of a rank above `MAX_VECTORS` is cut there; the returned
    `error_mm` says what was reached.
    """
    frames, vertices, _ = displacements.shape
    moving = np.flatnonzero(np.abs(displacements).max(axis=(0, 2)) > 0.0)
    flat = displacements[:, moving].reshape(frames, -1)
    weights, vectors = _components(flat)
    count, error = _smallest(flat, weights, vectors, error_mm / mm_per_unit)
    weights, vectors = weights[:, :count], vectors[:count]
    peak = np.abs(weights).max(axis=0)
    full = np.zeros((count, vertices, 3), dtype=np.float32)
    full[:, moving] = (vectors * peak[:, None]).reshape(count, -1, 3)
    return Basis(full, weights / peak, error * mm_per_unit)


def _components(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights `[T, K]` and orthonormal vectors `[K, N]` of `flat` `[T, N]`, largest first."""
    gram = (flat @ flat.T).astype(np.float64)
    values, modes = np.linalg.eigh(gram)
    order = np.argsort(values)[::-1][:MAX_VECTORS]
    # Below this share of the largest value float32 products hold nothing but rounding.
    order = order[values[order] > values[order[0]] * 1e-9]
    modes = modes[:, order].astype(np.float32)
    length = np.sqrt(values[order]).astype(np.float32)
    return modes * length, (modes / length).T @ flat


def _smallest(flat, weights, vectors, limit: float) -> tuple[int, float]:
    """The smallest number of vectors with an error of at most `limit`, and that error."""
    low, high = 1, len(vectors)
    best = high, _largest_error(flat, weights, vectors, high)
    while low < high:
        middle = (low + high) // 2
        error = _largest_error(flat, weights, vectors, middle)
        if error <= limit:
            high, best = middle, (middle, error)
        else:
            low = middle + 1
    return best


def _largest_error(flat, weights, vectors, count: int) -> float:
    """Largest distance of a vertex from its place with `count` vectors, in the units of `flat`."""
    worst = 0.0
    for start in range(0, len(flat), 64):
        rows = slice(start, start + 64)
        rest = flat[rows] - weights[rows, :count] @ vectors[:count]
        rest = rest.reshape(len(rest), -1, 3)
        worst = max(worst, float(np.einsum("tvc,tvc->tv", rest, rest).max()))
    return worst**0.5
