"""The best linear map from a tool's outputs to the mouth, with its best delay and smoothing."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from training.benchmarks.peers.recordings import Recording
from training.corpus.clip import FPS

PENALTIES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
FOLDS = 4
LAGS = range(-8, 9)
SMOOTHINGS = (0.0, 1.0, 2.0)
FINE = 8
LEAST_SCALE = 0.05
"""Least deviation of an output, as a share of that of the liveliest output.

Outputs that hardly move are scaled as if they had this deviation.
"""


def at_frames(times_s: np.ndarray, values: np.ndarray, frames: int) -> np.ndarray:
    """Resamples values [N, K] at rising times [N] to 25 fps, [frames, K].

    Interpolates linearly and takes the mean over the 40 ms around each frame.
    """
    fine_s = (np.arange(frames * FINE) - 0.5 * (FINE - 1)) / (FPS * FINE)
    columns = [np.interp(fine_s, times_s, column) for column in values.T]
    return np.stack(columns, axis=1).reshape(frames, FINE, -1).mean(axis=1)


def smoothed(x: np.ndarray, sigma: float) -> np.ndarray:
    """Smooths [T, K] with a Gaussian of `sigma` frames; 0 changes nothing."""
    return gaussian_filter1d(x, sigma, axis=0, mode="nearest") if sigma else x


def shifted(x: np.ndarray, lag: int) -> np.ndarray:
    """Moves [T, K] `lag` frames earlier; the end values repeat."""
    return x[np.clip(np.arange(len(x)) + lag, 0, len(x) - 1)]


@dataclass
class LinearMap:
    """`y = (x − centre) / scale @ weights + offset`."""

    centre: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    offset: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Maps [T, K] to [T, D]."""
        return (x - self.centre) / self.scale @ self.weights + self.offset


@dataclass
class Moments:
    """Sums over the frames of a clip: their number, x [K], y [D], xᵀx [K, K], xᵀy [K, D] and y² [D]."""

    count: int
    x: np.ndarray
    y: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray) -> "Moments":
        """The moments of outputs [T, K] and mouths [T, D]."""
        return cls(len(x), x.sum(axis=0), y.sum(axis=0), x.T @ x, x.T @ y, np.square(y).sum(axis=0))

    def __add__(self, other: "Moments") -> "Moments":
        return Moments(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    def deviations(self) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations of x and y."""
        squares = np.diag(self.xx), self.yy
        means = self.x / self.count, self.y / self.count
        return tuple(
            np.sqrt(np.maximum(s / self.count - m * m, 0.0)) for s, m in zip(squares, means, strict=True)
        )

    def standard(self, centre: np.ndarray, scale: np.ndarray, offset: np.ndarray, size: np.ndarray) -> tuple:
        """xᵀx, xᵀy and the sum of y² of `(x − centre) / scale` and `(y − offset) / size`."""
        xx = (
            self.xx
            - np.outer(self.x, centre)
            - np.outer(centre, self.x)
            + self.count * np.outer(centre, centre)
        )
        xy = (
            self.xy
            - np.outer(self.x, offset)
            - np.outer(centre, self.y)
            + self.count * np.outer(centre, offset)
        )
        yy = self.yy - 2.0 * offset * self.y + self.count * offset * offset
        return xx / np.outer(scale, scale), xy / np.outer(scale, size), float((yy / (size * size)).sum())


def ridge(clips: list[Moments]) -> LinearMap:
    """Ridge regression from outputs to the mouth over several clips.

    The penalty is the one of `PENALTIES` (shares of the number of frames, on outputs of unit deviation) with
    the least squared error in a four-fold cross-validation over the clips.
    """
    whole = sum(clips[1:], clips[0])
    scale, size = whole.deviations()
    scale = np.maximum(scale, LEAST_SCALE * scale.max())
    centre, offset = whole.x / whole.count, whole.y / whole.count
    errors = np.zeros(len(PENALTIES))
    for fold in range(min(FOLDS, len(clips))):
        training_clips = [clip for k, clip in enumerate(clips) if k % FOLDS != fold]
        test_clips = clips[fold::FOLDS]
        inside = sum(training_clips[1:], training_clips[0])
        xx, xy, _ = inside.standard(centre, scale, offset, size)
        out_xx, out_xy, out_yy = sum(test_clips[1:], test_clips[0]).standard(centre, scale, offset, size)
        for k, penalty in enumerate(PENALTIES):
            w = solve(xx, xy, penalty * inside.count)
            errors[k] += out_yy - 2.0 * (w * out_xy).sum() + (w * (out_xx @ w)).sum()
    xx, xy, _ = whole.standard(centre, scale, offset, size)
    weights = solve(xx, xy, PENALTIES[errors.argmin()] * whole.count)
    return LinearMap(centre, scale, weights * size, offset)


def solve(xx: np.ndarray, xy: np.ndarray, penalty: float) -> np.ndarray:
    """Weights [K, D] of ridge regression."""
    return np.linalg.solve(xx + penalty * np.eye(len(xx)), xy)


@dataclass
class Fitted:
    """Mouths [T, D] by recording, and the delay and smoothing used, both in frames."""

    mouths: dict[str, np.ndarray]
    lag: int
    sigma: float


def best_fit(
    outputs: dict[str, np.ndarray],
    turns: list[tuple[list[Recording], list[Recording]]],
    score: Callable[[dict[str, np.ndarray]], float],
) -> Fitted:
    """Mouths of the judged recordings from a tool's `outputs` [T, K] at 25 fps.

    `turns` are pairs: recordings to fit a map to, and recordings to judge with it. Delay and smoothing are
    those with the highest `score` on the judged recordings. That favours the tools.
    """
    learned = {r.name: r for chosen, _ in turns for r in chosen}
    needed = learned.keys() | {r.name for _, judged in turns for r in judged}
    best, highest = None, -np.inf
    for sigma in SMOOTHINGS:
        smooth = {name: smoothed(outputs[name], sigma) for name in needed}
        for lag in LAGS:
            moved = {name: shifted(x, lag) for name, x in smooth.items()}
            sums = {n: Moments.of(moved[n][r.judged], r.truth[r.judged]) for n, r in learned.items()}
            mouths = {}
            for chosen, judged in turns:
                line = ridge([sums[r.name] for r in chosen])
                mouths |= {r.name: line(moved[r.name]) for r in judged}
            reached = score(mouths)
            if reached > highest:
                best, highest = Fitted(mouths, lag, sigma), reached
    return best
