"""Redoes a stretch of a finished take that is stored as frames, not as weights of keys.

Caches, tables and one key per frame hold a take frame by frame; the controls of a rig are fitted
anew. Runs in the worker thread, without Blender.
"""

import shutil
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import pc2
from .errors import AnyfaceError
from .job import Progress
from .plan import Plan, WriteTable, all_or_none, of_piece, take_back
from .take import Files, Take, WrittenFile


@dataclass
class FilmRedo:
    """Redoes the frames `rows` of a take, which lie between the scene frames `bounds`.

    `snapshot` is a `scene.bake.Snapshot`; `plan` finishes the new frames.
    """

    snapshot: Any
    rows: range
    plan: Plan
    bounds: tuple[float, float]

    def work(self, progress: Progress) -> Take:
        """A take of only these frames; raises `AnyfaceError`, or `Cancelled`."""
        snapshot = self.snapshot
        take = snapshot.perform(progress, self.rows)
        return self.plan.finish(snapshot.face, take, snapshot.engine, progress)


@dataclass
class PatchCaches(Plan):
    """Copies caches and mixes the new motion into frames from `first` on, by `shares` `[n]`.

    `paths` are the old and the new path by object; `ease` frames lead from rest and back to it.
    """

    paths: dict[str, tuple[str, str]]
    first: int
    shares: np.ndarray
    ease: int

    def finish(self, face, take, engine, progress):
        files = []
        with all_or_none(files):
            for name, (old, new) in self.paths.items():
                rest, moved = of_piece(face, take.motion.displacements, name)
                with _fresh_copy(Path(old), Path(new)) as partial_path:
                    with pc2.patch(partial_path, len(rest), self.ease) as frames:
                        progress.check("write")
                        self._patch(frames, rest, moved)
                    count = len(frames) - 2 * self.ease
                files.append(WrittenFile(name, new, count, len(rest), self.ease))
        return replace(take, motion=Files(files))

    def _patch(self, frames: pc2.Frames, rest: np.ndarray, moved: np.ndarray) -> None:
        """Mixes frames of a cache, then eases again from rest and back to it."""
        place, ease = self.first + self.ease, self.ease
        for number in map(int, np.flatnonzero(self.shares[: len(moved)] > 0.0)):
            was, share = frames[place + number], np.float32(self.shares[number])
            if place + number < len(frames) - ease:
                frames[place + number] = was + share * (rest + moved[number] - was)
        last = len(frames) - ease - 1
        ends = last - place
        for number in range(ease):
            strength = np.float32(number / ease)
            if self.first == 0 and self.shares[0] > 0.0:
                frames[number] = rest + strength * (frames[ease] - rest)
            if ends < len(self.shares) and self.shares[ends] > 0.0:
                frames[len(frames) - 1 - number] = rest + strength * (frames[last] - rest)


@contextmanager
def _fresh_copy(old: Path, new: Path):
    """Yields a copy beside `new` and renames it to `new` at the end; a failure leaves nothing."""
    part = new.with_name(new.name + ".part")
    try:
        try:
            new.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(old, part)
        except OSError as error:
            text = f"{old}: {error.strerror or error}: generate again"
            raise AnyfaceError("file", text) from error
        yield part
        part.replace(new)
    finally:
        part.unlink(missing_ok=True)


@dataclass
class PatchTable(Plan):
    """Writes the table `old` to the path of `table`, and mixes new weights into its rows from
    `first` on by `shares` `[n]`. Every other row stays the same to the letter."""

    table: WriteTable
    old: str
    first: int
    shares: np.ndarray

    def finish(self, face, take, engine, progress):
        before = _text(self.old).splitlines(keepends=True)
        table = self.table.finish(face, take, engine, progress)
        (file,) = table.motion.files
        try:
            rows = _text(file.waits).splitlines()[1:]
            for number in np.flatnonzero(self.shares[: len(rows)] > 0.0):
                place = 1 + self.first + number
                if place < len(before):
                    share = float(self.shares[number])
                    before[place] = mixed(before[place], rows[number], share)
            Path(file.waits).write_text("".join(before), encoding="utf-8", newline="")
        except BaseException:
            take_back([file])
            raise
        file.frames = len(before) - 1
        return table


def _text(path: str) -> str:
    """The text of a table; raises `AnyfaceError("file")`."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        text = f"{path}: no table that can be read ({error}): generate again"
        raise AnyfaceError("file", text) from error


def mixed(old: str, new: str, share: float) -> str:
    """A mixture of two rows of a table; times, counts and the line end are those of `old`."""
    fields, others = old.rstrip("\r\n").split(","), new.split(",")
    end = old[len(old.rstrip("\r\n")) :]
    for number, (was, is_now) in enumerate(zip(fields, others, strict=True)):
        if number >= 2 and "." in was:
            fields[number] = f"{(1.0 - share) * float(was) + share * float(is_now):.6f}"
    return ",".join(fields) + end
