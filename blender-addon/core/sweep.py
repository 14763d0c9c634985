"""Controls that change over time: motion at the ends of a slider's way, mixed frame by frame.

The library takes one value of each control for a whole performance. What the controls do to the
motion is close to linear in their value, and lips that are closed at both ends stay closed in
between.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .take import Controls

# Controls whose value can sensibly differ from frame to frame; smoothing and the rate of blinks
# belong to the whole take.
ANIMATABLE = ("articulation", "jaw_lips", "upper_face", "brow_accents", "asymmetry")
# Pieces into which the way of one slider is cut.
_PIECES = 2


def over_time(
    base: np.ndarray,
    fps: float,
    controls: Controls,
    keys: dict[str, tuple[np.ndarray, np.ndarray]],
    sample: Callable[[Controls], np.ndarray],
) -> np.ndarray:
    """The motion `[T, 68, 3]` in which every control of `keys` follows its curve.

    `base` is the motion at `controls`. `keys` holds, by name, times in seconds and values, linear
    in between. `sample(controls)` gives the motion at constant controls.
    """
    at = np.arange(len(base)) / fps
    moved = base.copy()
    for name, (times, values) in keys.items():
        curve = np.interp(at, times, values)
        moved += along(curve, lambda x, n=name: sample(replace(controls, **{n: x}))) - base
    return moved


def along(values: np.ndarray, motion_at: Callable[[float], np.ndarray]) -> np.ndarray:
    """The motion whose frame `t` is that of the slider at `values[t]`."""
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-6:
        return motion_at(low)
    knots = np.linspace(low, high, _PIECES + 1)
    motions = np.stack([motion_at(float(knot)) for knot in knots])
    place = (values - low) / (high - low) * _PIECES
    first = np.minimum(place.astype(int), _PIECES - 1)
    share = (place - first)[:, None, None]
    frames = np.arange(len(values))
    return motions[first, frames] * (1.0 - share) + motions[first + 1, frames] * share
