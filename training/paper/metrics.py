"""The metrics of the FreeTalk paper (§4.2), with Rust twins in `tests/eval/src/metrics`.

Shapes: `P` prediction and `G` truth [T, N, 3], displacements from the neutral face; `lips` and `upper` are
indices of points. Lengths have the unit of the motion; LVE, EVE, FDD and δM have its square.
"""

import numpy as np
from scipy.spatial.distance import cdist

NAMES = ("LVE", "EVE", "MVE", "FDD", "DTW", "DFD", "δM", "δCd")


def measure(p: np.ndarray, g: np.ndarray, lips: np.ndarray, upper: np.ndarray) -> dict[str, float]:
    """All metrics of one clip."""
    p, g = np.asarray(p, np.float64), np.asarray(g, np.float64)
    lips_p, lips_g = (x[:, lips].reshape(len(x), -1) for x in (p, g))
    between = cdist(lips_p, lips_g)
    return {
        "LVE": worst_point(p[:, lips], g[:, lips]),
        "EVE": worst_point(p[:, upper], g[:, upper]),
        "MVE": float(np.linalg.norm(p - g, axis=-1).mean()),
        "FDD": upper_dynamics(g[:, upper]) - upper_dynamics(p[:, upper]),
        "DTW": float(warped(between, np.add)),
        "DFD": float(warped(between, np.maximum)),
        "δM": float(np.square(np.diff(p, axis=0) - np.diff(g, axis=0)).sum(-1).mean()),
        "δCd": cosine_distance(np.diff(p, axis=0), np.diff(g, axis=0)),
    }


def worst_point(p: np.ndarray, g: np.ndarray) -> float:
    """Mean over frames of the largest squared distance (LVE; EVE over eyes and forehead)."""
    return float(np.square(p - g).sum(-1).max(1).mean())


def upper_dynamics(x: np.ndarray) -> float:
    """Mean over points of the deviation over time of the squared motion (FDD is the truth's minus ours)."""
    return float(np.square(x).sum(-1).std(0).mean())


def warped(between: np.ndarray, joined: np.ufunc) -> float:
    """Cost of the best monotone path through distances [T, S]: a sum (DTW), or its longest step (DFD)."""
    return float(path_costs(between, joined)[-1, -1])


def path_costs(between: np.ndarray, joined: np.ufunc) -> np.ndarray:
    """Cost of the best monotone path from the first cell to each cell, [T + 1, S + 1].

    Row and column 0 stand before the start: they hold infinity, and 0 in the corner. The cells of an
    antidiagonal depend only on the two antidiagonals before it, so they are computed together.
    """
    rows, columns = between.shape
    cost = np.full((rows + 1, columns + 1), np.inf)
    cost[0, 0] = 0.0
    for diagonal in range(2, rows + columns + 1):
        i = np.arange(max(1, diagonal - columns), min(rows, diagonal - 1) + 1)
        j = diagonal - i
        before = np.minimum(np.minimum(cost[i - 1, j], cost[i, j - 1]), cost[i - 1, j - 1])
        cost[i, j] = joined(between[i - 1, j - 1], before)
    return cost


def best_path(cost: np.ndarray) -> list[tuple[int, int]]:
    """Cells of the cheapest path through `path_costs`, last first; a diagonal step wins a tie."""
    i, j = (n - 1 for n in cost.shape)
    path = []
    while i > 0 and j > 0:
        path.append((i - 1, j - 1))
        i, j = min(((i - 1, j - 1), (i - 1, j), (i, j - 1)), key=lambda cell: cost[cell])
    return path


def cosine_distance(p: np.ndarray, g: np.ndarray) -> float:
    """Mean of `1 − cos` between the steps of prediction and truth."""
    size = np.linalg.norm(p, axis=-1) * np.linalg.norm(g, axis=-1)
    cosine = (p * g).sum(-1) / np.maximum(size, 1e-12)
    return float(1.0 - cosine.mean())
