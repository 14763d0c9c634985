"""PC2 point caches: positions of every vertex in every frame, as Mesh Cache modifiers read them."""

import os
import struct
from pathlib import Path

import numpy as np

from .errors import AnyfaceError
from .job import Progress

_HEADER = "<12siiffi"


def frame_count(frames: int, ease: int) -> int:
    """Frames of a cache of `frames` with `ease` more before and after."""
    return frames + 2 * ease


def file_size(frames: int, vertices: int) -> int:
    """Bytes of a cache."""
    return struct.calcsize(_HEADER) + frames * vertices * 12


def write(path: Path, rest: np.ndarray, moved: np.ndarray, ease: int, progress: Progress) -> None:
    """Writes `rest` `[V, 3]` + `moved` `[T, V, 3]`; a cancelled or failed write leaves nothing.

    `ease` frames lead from rest to the first frame, as many from the last back to rest.
    Raises `AnyfaceError("file")`, or `Cancelled`.
    """
    partial = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with open(partial, "wb") as file:
                count = frame_count(len(moved), ease)
                head = (b"POINTCACHE2\0", 1, len(rest), 0.0, 1.0, count)
                file.write(struct.pack(_HEADER, *head))
                for number in range(count):
                    progress.check("write", number / count)
                    file.write(_frame(rest, moved, ease, number).tobytes())
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error


def _frame(rest, moved, ease: int, number: int) -> np.ndarray:
    t = number - ease
    last = len(moved) - 1
    strength = 1.0 - max(-t, t - last, 0) / max(ease, 1)
    return (rest + strength * moved[min(max(t, 0), last)]).astype("<f4")
