"""The metrics of the FreeTalk paper (§4.2); numbers of the Rust twins in `tests/eval/src/metrics`.

Shapes: `P` prediction and `G` truth [T, N, 3], displacements from the neutral face; `lips` and `upper` are
numbers of points. Lengths come out in the unit of the motion, LVE, EVE and δM in its square.
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
    """Mean over points of the deviation over time of the squared motion (FDD is the truth's less ours)."""
    return float(np.square(x).sum(-1).std(0).mean())


def warped(between: np.ndarray, joined) -> float:
    """Cost of the best monotone path through distances [T, S]: a sum (DTW), or its longest step (DFD)."""
    cost = np.full((between.shape[0] + 1, between.shape[1] + 1), np.inf)
    cost[0, 0] = 0.0
    for i, row in enumerate(between, 1):
        for j, distance in enumerate(row, 1):
            cost[i, j] = joined(distance, min(cost[i - 1, j], cost[i, j - 1], cost[i - 1, j - 1]))
    return cost[-1, -1]


def cosine_distance(p: np.ndarray, g: np.ndarray) -> float:
    """Mean of `1 − cos` between the steps of prediction and truth."""
    size = np.linalg.norm(p, axis=-1) * np.linalg.norm(g, axis=-1)
    cosine = (p * g).sum(-1) / np.maximum(size, 1e-12)
    return float(1.0 - cosine.mean())
