"""Curves with few keys instead of one key a frame."""

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np

from .job import Progress
from .take import HeldKeys, Landmarks, Take

EVERY_FRAME, SPARSE = "EVERY", "SPARSE"
# Landmarks of the inner lips that meet. Lips that are at most this much farther apart than at rest
# count as touching, mm.
_UPPER, _LOWER = [61, 62, 63], [67, 66, 65]
_TOUCH_MM = 0.1
# The error allowed for one curve of many, as a share of the error allowed for all together.
ALONE = 0.25
# Blender waits this many seconds at a time for the keys of a curve, then goes on.
_WAIT_S = 0.01
# How far handles reach, as a share of the distance to the next key; the same as in the library.
REACH = 0.39


def touching(landmarks: Landmarks, unit_mm: float) -> np.ndarray:
    """Whether the lips are as close as at rest, or closer, in each frame `[T]`; `unit_mm` is the
    length of a unit of the landmarks."""
    return opening(landmarks, unit_mm) <= _TOUCH_MM


def opening(landmarks: Landmarks, unit_mm: float) -> np.ndarray:
    """How much farther apart the lips are in each frame than at rest, mm, `[T]`."""
    moved = landmarks.neutral + landmarks.displacements
    gaps = np.linalg.norm(moved[:, _UPPER] - moved[:, _LOWER], axis=2).mean(axis=1)
    rest = np.linalg.norm(landmarks.neutral[_UPPER] - landmarks.neutral[_LOWER], axis=1).mean()
    return (gaps - rest) * unit_mm


def thin(take: Take, vectors, engine, tolerance_mm: float, progress: Progress) -> None:
    """Finds few keys for a take's weights; `vectors` `[K, V, 3]` are its shapes, in its unit."""
    motion: Any = take.motion
    tolerance = tolerance_mm / take.unit_mm
    keys = engine.few_keys(motion.weights, vectors, tolerance, take.touching, progress)
    motion.keys_of_curves = keys


@dataclass
class Few:
    """Finds few keys for curves that are made one by one. Together the curves stay about within
    `tolerance_mm`."""

    engine: Any
    tolerance_mm: float

    def keys(self, values: np.ndarray, size_mm: float):
        """Finds the keys of a curve `[T]`, where a value of 1 moves a point by up to `size_mm`.
        Yields while a thread beside Blender's own looks for them."""
        limit = np.array([ALONE * self.tolerance_mm / max(size_mm, 1e-9)])
        keys_found = []
        way = threading.Thread(
            target=lambda: keys_found.append(self.engine.few_keys_each(values[:, None], limit)[0])
        )
        way.start()
        way.join(_WAIT_S)
        while way.is_alive():
            yield
            way.join(_WAIT_S)
        return keys_found[0] if keys_found else None


def describe(take: Take, tolerance_mm: float) -> str:
    """How many keys were set: "1046 keys on curves within 0.2 mm", "60 poses held"; empty if every
    frame has a key."""
    keys = getattr(take.motion, "keys_of_curves", None)
    if keys is None:
        return ""
    if all(isinstance(one, HeldKeys) for one in keys):
        return f"{len(keys[0].rows) if keys else 0} poses held"
    return f"{sum(len(one.rows) for one in keys)} keys on curves, within {tolerance_mm:g} mm"
