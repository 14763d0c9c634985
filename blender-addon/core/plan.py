"""Finishes a take in the worker thread, after the face has moved and before the take is written.

Runs after `core.perform`, without Blender.
"""

import uuid
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import finding, pc2, shapes, sliders
from .errors import AnyfaceError
from .job import Progress
from .take import (
    NETWORK,
    ClipMotion,
    FaceMesh,
    Files,
    KeyMotion,
    Rig,
    ShapesBy,
    Solved,
    Take,
    WrittenFile,
)

# If the artist's keys leave out more than this share of the motion, nobody sees them speak.
_LARGEST_LEFT_OUT = 0.97


class Plan:
    """Writes the take as it is. Other plans replace its frames with another motion; if a plan
    `keeps_clip`, the frames stay in the library."""

    keeps_clip = False

    def finish(self, face: FaceMesh, take: Take, engine, progress: Progress) -> Take:
        """The take in the form that is written; raises `AnyfaceError`, or `Cancelled`."""
        return take

    def moves(self, take: Take) -> np.ndarray | None:
        """The vectors `[K, V, 3]` that a finished take's weights move; None without weights."""
        weights = getattr(take.motion, "weights", None)
        return getattr(take.motion, "vectors", None) if weights is not None else None


class PackSliders(Plan):
    """Packs the changes that the sliders of a basis make, to keep them with the take."""

    def finish(self, face, take, engine, progress):
        if take.motion.sliders:
            take.motion.packed = sliders.pack(take.motion.sliders)
        return take


@dataclass
class WriteCaches(Plan):
    """Writes point caches to `paths`, by object; `ease` frames lead from rest and back to it."""

    paths: dict[str, str]
    ease: int

    def finish(self, face, take, engine, progress):
        files = []
        with all_or_none(files):
            for name, path in self.paths.items():
                rest, moved = of_piece(face, take.motion.displacements, name)
                if files and not moved.any():
                    continue
                pc2.write(Path(path), rest, moved, self.ease, progress)
                files.append(WrittenFile(name, path, len(moved), len(rest), self.ease))
        return replace(take, motion=Files(files))


@contextmanager
def all_or_none(files: list[WrittenFile]):
    """If one file of a take cannot be written, deletes those that were written before it."""
    try:
        yield
    except BaseException:
        take_back(files)
        raise


def put(file: WrittenFile) -> None:
    """Moves a waiting file to its path; a file that was there is kept at `earlier`."""
    path = Path(file.path)
    if path.exists():
        earlier = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}.before{path.suffix}")
        path.replace(earlier)
        file.earlier = str(earlier)
    Path(file.waits).replace(path)
    file.waits = ""


def take_back(files: list[WrittenFile]) -> None:
    """Deletes the files of an unwanted take and puts the earlier files back in their places."""
    for file in files:
        Path(file.waits or file.path).unlink(missing_ok=True)
        if file.earlier:
            Path(file.earlier).replace(file.path)
            file.earlier = ""


def settle(files: list[WrittenFile]) -> None:
    """Deletes the earlier files, because the files of the take are in use now."""
    for file in files:
        if file.earlier:
            Path(file.earlier).unlink(missing_ok=True)
            file.earlier = ""


@dataclass
class SolveKeys(Plan):
    """Finds weights of the artist's `keys` `[K]`, whose displacements in object space are `vectors`
    `[K, V, 3]`. At weight 1 of each of `shapes` `[S]` the keys have the values `factors` `[S, K]`.
    `shown` maps each key to the shape that it shows most of."""

    shapes: list[str]
    keys: list[str]
    factors: np.ndarray
    vectors: np.ndarray
    shown: dict[str, str]
    keeps_clip = True

    def finish(self, face, take, engine, progress):
        # The keys are those of the face's own object; objects beside it have other keys.
        solved = as_made(take, self.shapes)
        if solved is None:
            vectors = shape_vectors(face, self.shapes, self.factors, self.vectors, engine, progress)
            solved = _solved(face, take, engine, self.shapes, vectors, progress)
        if solved.left_out > _LARGEST_LEFT_OUT:
            shown = 1.0 - solved.left_out
            raise AnyfaceError(
                "nothing_moved",
                f"nothing would move: the keys of {face.name} show {shown:.0%} of the motion: "
                "check the list of keys, or choose New Keys",
            )
        weights = np.clip(solved.weights @ self.factors, 0.0, 1.0).astype(np.float32)
        motion = KeyMotion(self.keys, weights, solved.left_out)
        motion.shapes, motion.shape_weights = self.shapes, solved.weights
        motion.shown, motion.factors = self.shown, by_key(self.shapes, self.keys, self.factors)
        if take.shape_weights is not None:
            motion.missing = take.shape_weights.missing(self.shapes)
        return replace(take, motion=motion)

    def moves(self, take):
        return self.vectors


def _solved(face, take: Take, engine, names, vectors, progress: Progress, path: str = "") -> Solved:
    """Solves weights of the shapes `vectors` `[S, V, 3]` of a face, in object space. Uses the clip
    if the take has one. With `path` the weights are also written there."""
    motion: Any = take.motion
    face_found = finding.find(face, {}, engine.find, progress)
    shapes = names, vectors, face_found.lips(vectors.shape[1])
    if isinstance(motion, ClipMotion):
        return motion.clip.weights(*shapes, motion.way, progress, path, take.fps)
    moved = motion.displacements[:, : vectors.shape[1]]
    return engine.solve(*shapes, moved, progress, path, take.fps)


def as_made(take: Take, names: list[str]) -> Solved | None:
    """The weights of the shapes `names` that the system made itself; None if it made none of these.

    Systems make no visemes: where these are among `names`, all weights have to be solved.
    """
    weights = take.shape_weights
    if weights is None or not set(names) & set(weights.names) or set(names) & set(shapes.VISEMES):
        return None
    return Solved(weights.of(names), weights.left_out(names))


def shape_vectors(
    face: FaceMesh, names: list[str], factors, vectors, engine, progress: Progress
) -> np.ndarray:
    """What the shapes `names` `[S]` move in object space, `[S, V, 3]` float32.

    `vectors` `[K, V, 3]` are the artist's keys, which stand at `factors` `[S, K]`. A face that
    stands in for the artist's mesh has shapes of its own.
    """
    if not face.stands_in:
        return np.tensordot(factors, vectors, axes=1).astype(np.float32)
    rig = make_rig(face, engine, progress)
    return np.ascontiguousarray(rig.vectors[[rig.names.index(name) for name in names]])


def by_key(shapes: list[str], keys: list[str], factors: np.ndarray) -> dict[str, dict[str, float]]:
    """The value of each of `keys` `[K]` at weight 1 of each of `shapes` `[S]` that it shows."""
    columns = zip(keys, factors.T, strict=True)
    rows = {key: zip(shapes, column, strict=True) for key, column in columns}
    return {key: {shape: float(f) for shape, f in row if f} for key, row in rows.items()}


@dataclass
class MakeKeys(Plan):
    """Makes keys of the ARKit shapes, with weights; with `visemes` those too, without weights."""

    visemes: bool
    keeps_clip = True

    def finish(self, face, take, engine, progress):
        arkit, visemes = _arkit(face, engine, progress)
        weights = take.shape_weights
        if weights is not None:
            solved = Solved(weights.of(arkit.names), weights.left_out(arkit.names))
        else:
            solved = _solved(face, take, engine, arkit.names, arkit.vectors, progress)
        motion = KeyMotion(arkit.names, solved.weights, solved.left_out, arkit.vectors)
        motion.visemes = visemes if self.visemes else None
        return replace(take, motion=motion)


@dataclass
class WriteTable(Plan):
    """Writes a table of ARKit weights for the object `name`; the file waits beside `path`."""

    name: str
    path: str
    keeps_clip = True

    def finish(self, face, take, engine, progress):
        path = Path(self.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        waits = str(path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}.part.csv"))
        try:
            return replace(take, motion=Files([self._write(waits, face, take, engine, progress)]))
        except BaseException:
            Path(waits).unlink(missing_ok=True)
            raise

    def _write(self, waits: str, face, take, engine, progress) -> WrittenFile:
        weights = take.shape_weights
        if weights is not None:
            engine.write_weights(weights.names, weights.weights, waits, take.fps)
            return WrittenFile(self.name, self.path, len(weights.weights), waits=waits)
        arkit, _ = _arkit(face, engine, progress)
        solved = _solved(face, take, engine, arkit.names, arkit.vectors, progress, waits)
        left_out = solved.left_out
        return WrittenFile(self.name, self.path, take.frame_count, left_out=left_out, waits=waits)


def _arkit(face, engine, progress) -> tuple[Rig, Rig]:
    """The ARKit shapes of a face, and its visemes."""
    rig, count = make_rig(face, engine, progress), len(shapes.ARKIT)
    arkit, visemes = slice(count), slice(count, None)
    return (
        Rig(rig.names[arkit], rig.vectors[arkit]),
        Rig(rig.names[visemes], rig.vectors[visemes]),
    )


def make_rig(face: FaceMesh, engine, progress: Progress, by: ShapesBy = NETWORK) -> Rig:
    """The shapes of a face in object space."""
    rig = engine.rig(*face.space.to_library(face), face.roles, progress, by)
    rig.vectors = face.space.to_object(rig.vectors)
    return rig


def of_piece(face: FaceMesh, moved: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rest `[V, 3]` and motion `[T, V, 3]` of one object of the face, in its own space."""
    piece = next((piece for piece in face.pieces if piece.name == name), None)
    if piece is None or len(face.pieces) == 1:
        return face.positions, moved
    back = np.linalg.inv(piece.matrix)
    turn = back[:3, :3].T.astype(np.float32)
    rest = face.positions[piece.rows] @ turn + back[:3, 3].astype(np.float32)
    return rest, moved[:, piece.rows] @ turn
