"""Holds poses, as in drawn and stop-motion animation: on twos, threes, fours."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .sliders import SliderChange
from .take import Basis, ControlMotion, HeldKeys, Life, Take

HELD = "HELD"


@dataclass(frozen=True)
class Holds:
    """How long poses are held: they change every `on` frames of a take.

    Poses in which the lips touch last at least `closures` frames, poses in which the mouth is
    widest at least `vowels` frames.
    """

    on: int = 2
    closures: int = 2
    vowels: int = 2


def poses(opening: np.ndarray, touching: np.ndarray, holds: Holds) -> np.ndarray:
    """The frame whose pose is shown in each frame, `[T]`.

    `opening` `[T]` is how far the lips are apart, in any unit, `touching` `[T]` where they touch.
    If the lips touch in any frame of a pose, the pose shows such a frame.
    """
    count, on = len(opening), max(holds.on, 1)
    firsts = np.arange(0, count, on)
    source = np.minimum(firsts + (on - 1) // 2, count - 1)
    closed = np.zeros(len(firsts), dtype=bool)
    for number, first in enumerate(firsts):
        here = np.flatnonzero(touching[first : first + on])
        if len(here):
            # The frame in which the lips are closed most firmly.
            source[number] = first + here[opening[first + here].argmin()]
            closed[number] = True
    boundaries = closed.copy()
    _stretch(source, boundaries, _runs(closed), -(-holds.closures // on))
    open_ = np.where(boundaries, -np.inf, opening[source])
    tops = [
        (number, number + 1)
        for number in range(1, len(firsts) - 1)
        if not boundaries[number]
        and open_[number] > open_[number - 1]
        and open_[number] >= open_[number + 1]
    ]
    _stretch(source, boundaries, tops, -(-holds.vowels // on))
    return source[np.arange(count) // on]


def _runs(marks: np.ndarray) -> list[tuple[int, int]]:
    """Start and end of each run of marks."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _stretch(source: np.ndarray, boundaries: np.ndarray, runs, least: int) -> None:
    """Extends each run to `least` poses, at its end first, as far as `boundaries` allow."""
    for begin, end in runs:
        first, last = begin, end
        while last - first < least:
            if last < len(source) and not boundaries[last]:
                source[last], last = source[last - 1], last + 1
            elif first > 0 and not boundaries[first - 1]:
                source[first - 1], first = source[first], first - 1
            else:
                break
        boundaries[first:last] = True


def hold(take: Take, holds: Holds) -> bool:
    """Holds the poses of a take of weights or of a rig's controls.

    Does nothing and returns False if the take has neither. Sliders change the held poses. Head and
    eyes are held with the poses.
    """
    motion: Any = take.motion
    is_rig = isinstance(motion, ControlMotion)
    if not is_rig and getattr(motion, "weights", None) is None:
        return False
    count = motion.frame_count
    touching = take.touching if take.touching is not None else np.zeros(count, dtype=bool)
    opening = take.opening if take.opening is not None else np.zeros(count)
    source = poses(np.asarray(opening), np.asarray(touching, dtype=bool), holds)
    if take.life is not None:
        take.life = _held(take.life, source)
    rows = np.flatnonzero(np.diff(source, prepend=-1))
    if is_rig:
        motion.frames = motion.frames[source]
        motion.pose_frames = rows[np.searchsorted(rows, np.arange(count), side="right") - 1]
    else:
        _hold_weights(motion, source, rows)
    return True


def _hold_weights(motion, source: np.ndarray, rows: np.ndarray) -> None:
    """Shows in each frame the frame given by `source` `[T]`, which changes at `rows`."""
    motion.weights = motion.weights[source]
    if getattr(motion, "shape_weights", None) is not None:
        motion.shape_weights = motion.shape_weights[source]
    if isinstance(motion, Basis):
        motion.sliders = {
            name: SliderChange(change.knots, change.changes[:, source])
            for name, change in motion.sliders.items()
        }
    motion.keys_of_curves = [HeldKeys(rows) for _ in range(motion.weights.shape[1])]


def _held(life: Life, source: np.ndarray) -> Life:
    """Head and eyes in the frames `source` `[T]`."""
    moves = {name: getattr(life, name) for name in ("head", "gaze", "looked_at", "tongue")}
    return replace(life, **{name: of[source] for name, of in moves.items() if of is not None})
