"""The metrics of the FreeTalk paper (§4.2), with Rust twins in `tests/eval/src/metrics`, and MTM and SLCC.

Shapes: `P` prediction and `G` truth [T, N, 3], displacements from the neutral face; `lips` and `upper` are
indices of points. Lengths have the unit of the motion; LVE, EVE, FDD and δM have its square.

MTM and SLCC are those of Chae-Yeon et al., "Perceptually Accurate 3D Talking Head Generation" (CVPR 2025).
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
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


MISALIGNMENT_SIGMA = 2.0
"""Sigma in frames of the Gaussian that smooths openings for MTM, as in its authors' code."""


def temporal_misalignment(p: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Offset in frames, without sign, between paired extrema of the two openings: MTM is the mean.

    `p` and `g` [T] are the opening of the lips, predicted and true, in any unit. Both are smoothed by a
    Gaussian of 2 frames. Their first differences (0 in frame 0) are aligned by dynamic time warping with the
    absolute difference as distance. A local maximum of the truth and one of the prediction form a pair if
    the path joins their frames, unless the prediction's lies beyond a true extremum next to the true one.
    The same holds for minima. Extrema without a partner do not count. Returns one number for each pair, and
    an empty array if there are no pairs.
    """
    p, g = smooth_opening(p), smooth_opening(g)
    steps = [np.diff(x, prepend=x[0]) for x in (g, p)]
    path = best_path(path_costs(np.abs(steps[0][:, None] - steps[1]), np.add))
    true, predicted = extrema(g), extrema(p)
    order = [0, *sorted(true), len(g) - 1]
    place = {frame: k for k, frame in enumerate(order[1:-1], 1)}
    off = []
    for i, j in path:
        if i in true and predicted.get(j) == true[i] and order[place[i] - 1] <= j <= order[place[i] + 1]:
            off.append(abs(i - j))
    return np.array(off, np.float64)


def smooth_opening(x: np.ndarray) -> np.ndarray:
    """Smooths an opening [T] by the Gaussian of MTM."""
    return gaussian_filter1d(np.asarray(x, np.float64), MISALIGNMENT_SIGMA)


def extrema(x: np.ndarray) -> dict[int, bool]:
    """Frames of the local maxima (true) and minima (false) of [T]."""
    tops, bottoms = (find_peaks(sign * x)[0].tolist() for sign in (1, -1))
    return dict.fromkeys(tops, True) | dict.fromkeys(bottoms, False)


def lip_intensity(x: np.ndarray) -> float:
    """How much the lips move per frame, in the unit of `x` [T, N, D].

    It is the root mean square over frames of the points' mean step.
    """
    return float(np.sqrt(np.square(np.linalg.norm(np.diff(x, axis=0), axis=-1).mean(-1)).mean()))


def speech_lip_correlation(lips: np.ndarray, speech: np.ndarray) -> float:
    """SLCC: Pearson's r of `lip_intensity` and the sound's root mean square, both [clips], of one speaker.

    The paper first scales every speaker's intensities to mean 0 and deviation 1, which does not change r.
    """
    return float(np.corrcoef(lips, speech)[0, 1])


def cosine_distance(p: np.ndarray, g: np.ndarray) -> float:
    """Mean of `1 − cos` between the steps of prediction and truth."""
    size = np.linalg.norm(p, axis=-1) * np.linalg.norm(g, axis=-1)
    cosine = (p * g).sum(-1) / np.maximum(size, 1e-12)
    return float(1.0 - cosine.mean())
