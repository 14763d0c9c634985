"""PC2 point caches: positions of every vertex in every frame, as Mesh Cache modifiers read them."""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .errors import AnyfaceError
from .job import Progress

_HEADER = "<12siiffi"


def frame_count(frames: int, ease: int) -> int:
    """Frames in the cache of a take of `frames`, with `ease` more before and after."""
    return frames + 2 * ease


def file_size(frames: int, vertices: int) -> int:
    """Bytes of a cache."""
    return struct.calcsize(_HEADER) + frames * vertices * 12


def write(path: Path, rest: np.ndarray, moved: np.ndarray, ease: int, progress: Progress) -> None:
    """Writes `rest` `[V, 3]` + `moved` `[T, V, 3]`; a cancelled or failed write leaves nothing.

    `ease` frames lead from rest to the first frame, and as many from the last frame back to rest.
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


class Frames:
    """The `count` frames `[V, 3]` of an open cache; setting one changes the file.

    A memory map would do the same, but an error that still refers to it keeps the file open, and
    Windows deletes no open file.
    """

    def __init__(self, file: BinaryIO, vertices: int, count: int):
        self._file, self._vertices, self._count = file, vertices, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> np.ndarray:
        self._go_to(number)
        return np.frombuffer(self._file.read(12 * self._vertices), "<f4").reshape(-1, 3)

    def __setitem__(self, number: int, positions: np.ndarray) -> None:
        self._go_to(number)
        self._file.write(np.ascontiguousarray(positions, "<f4").tobytes())

    def _go_to(self, number: int) -> None:
        self._file.seek(file_size(number, self._vertices))


@contextmanager
def patch(path: Path, vertices: int, ease: int) -> Iterator[Frames]:
    """Opens a cache to change its frames.

    Raises `AnyfaceError("file")` if it is not a whole cache of `vertices` with `ease` frames at
    each end.
    """
    count = frames_in(path, vertices)
    if count <= 2 * ease or path.stat().st_size != file_size(count, vertices):
        raise AnyfaceError("file", f"{path.stem}: not a whole cache: generate again")
    with open(path, "r+b") as file:
        yield Frames(file, vertices, count)


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
