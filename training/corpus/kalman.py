"""A Kalman filter for parameters that a tracker reads off single frames (Kalman 1960).

EmoFace filters the FLAME parameters of 3D-RAVDESS so (Lin et al. 2025, §4.1) and prints neither the model of
the motion nor its noise. Here every parameter moves with a velocity that a random acceleration changes. Both
variances come from the track itself: the second and third differences of the model have the variances
`q / 2 + 6 r` and `q / 2 + 20 r`, with `q` of the acceleration and `r` of the tracking noise. A track whose
differences show no noise stays as it is.
"""

import numpy as np

SECOND, THIRD = 6.0, 20.0
"""Variance of the second and of the third difference of white noise of variance 1."""
LEAST_SHARE = 1e-4
"""Least variance of the acceleration, as a share of that of the noise. It keeps the filter awake."""
STEP = np.array([[1.0, 1.0], [0.0, 1.0]])
"""A frame later: value and velocity."""
ACCELERATION = np.array([[0.25, 0.5], [0.5, 1.0]])
"""Covariance that an acceleration of variance 1 adds to value and velocity within a frame."""


def noise_variances(track: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances of acceleration and of tracking noise of each channel, [C] each, from a track [T, C]."""
    second, third = (np.diff(track, n=order, axis=0).var(axis=0) for order in (2, 3))
    noise = np.maximum(third - second, 0.0) / (THIRD - SECOND)
    acceleration = 2.0 * (second - SECOND * noise)
    return np.maximum(acceleration, LEAST_SHARE * noise), noise


def filter_track(track: np.ndarray) -> np.ndarray:
    """Filters each channel of a track [T, C] from its first frame on. Returns [T, C].

    Tracks of fewer than five frames tell nothing about their noise and stay as they are.
    """
    if len(track) < 5:
        return track
    acceleration, noise = noise_variances(track)
    out, noisy = track.astype(float), noise > 0.0
    acceleration, noise = acceleration[noisy], noise[noisy]
    state = np.stack([track[0, noisy], np.zeros(noisy.sum())], axis=-1)
    spread = noise[:, None, None] * np.eye(2)
    for t, seen in enumerate(track[1:, noisy], 1):
        state = state @ STEP.T
        spread = STEP @ spread @ STEP.T + acceleration[:, None, None] * ACCELERATION
        gain = spread[:, :, 0] / (spread[:, 0, 0] + noise)[:, None]
        state = state + gain * (seen - state[:, 0])[:, None]
        spread = spread - gain[:, :, None] * spread[:, None, 0, :]
        out[t, noisy] = state[:, 0]
    return out
