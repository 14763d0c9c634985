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


def patched(path: Path, vertices: int, ease: int) -> np.ndarray:
    """The frames `[N, V, 3]` of a cache, which may be changed in its file.

    Raises `AnyfaceError("file")` where it is not one of `vertices` with `ease` more at its ends.
    """
    count = frames_in(path, vertices)
    if count <= 2 * ease or path.stat().st_size != file_size(count, vertices):
        raise AnyfaceError("file", f"{path.stem}: not a whole cache: generate again")
    shape = (count, vertices, 3)
    return np.memmap(path, "<f4", "r+", struct.calcsize(_HEADER), shape)


def first_frame(path: Path, vertices: int) -> np.ndarray:
    """The first frame `[V, 3]` of a cache of `vertices`, the mesh at rest.

    Raises `AnyfaceError("file")`.
    """
    frames_in(path, vertices)
    try:
        read = np.fromfile(path, "<f4", 3 * vertices, offset=struct.calcsize(_HEADER))
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
    if len(read) != 3 * vertices:
        raise AnyfaceError("file", f"{path.stem}: not a whole cache: generate again")
    return read.reshape(-1, 3)


def frames_in(path: Path, vertices: int) -> int:
    """How many frames a cache of `vertices` has; raises `AnyfaceError("file")`."""
    try:
        with open(path, "rb") as file:
            header = file.read(struct.calcsize(_HEADER))
            _, _, width, _, _, count = struct.unpack(_HEADER, header)
    except (OSError, struct.error) as error:
        raise AnyfaceError("file", f"{path}: no cache that can be read: {error}") from error
    if width != vertices:
        text = f"{path.stem}: expected a cache of {vertices} vertices, got {width}: generate again"
        raise AnyfaceError("file", text)
    return count


def _frame(rest, moved, ease: int, number: int) -> np.ndarray:
    t = number - ease
    last = len(moved) - 1
    strength = 1.0 - max(-t, t - last, 0) / max(ease, 1)
    return (rest + strength * moved[min(max(t, 0), last)]).astype("<f4")
