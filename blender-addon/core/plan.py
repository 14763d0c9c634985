"""What is done with a take in the worker thread, once the face has moved and before it is written.

Runs after `core.perform`, without Blender.
"""

import uuid
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

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

# Below this share of the motion nobody sees that the artist's keys speak.
_LARGEST_LEFT_OUT = 0.97


class Plan:
    """The take is written as it is. Other plans put another motion in place of its frames, which
    stay in the library where a plan `keeps_clip`."""

    keeps_clip = False

    def finish(self, face: FaceMesh, take: Take, engine, progress: Progress) -> Take:
        """The take as it is to be written; raises `AnyfaceError`, or `Cancelled`."""
        return take

    def moves(self, take: Take) -> np.ndarray | None:
        """What the weights of a finished take move, `[K, V, 3]`; None where it has none."""
        weights = getattr(take.motion, "weights", None)
        return take.motion.vectors if weights is not None else None


class PackSliders(Plan):
    """What the sliders of a basis change is packed, to be kept with the take."""

    def finish(self, face, take, engine, progress):
        if take.motion.sliders:
            take.motion.packed = sliders.pack(take.motion.sliders)
        return take


@dataclass
class WriteCaches(Plan):
    """Point caches at `paths`, by object, that come out of rest within `ease` frames."""

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
    """Where one of the files of a take cannot be written, those before it go."""
    try:
        yield
    except BaseException:
        take_back(files)
        raise


def put(file: WrittenFile) -> None:
    """Puts a file that waits in its place; what lay there waits from now on."""
    path = Path(file.path)
    if path.exists():
        earlier = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}.before{path.suffix}")
        path.replace(earlier)
        file.earlier = str(earlier)
    Path(file.waits).replace(path)
    file.waits = ""


def take_back(files: list[WrittenFile]) -> None:
    """The files of a take that nobody wants go; what lay in their places lies there again."""
    for file in files:
        Path(file.waits or file.path).unlink(missing_ok=True)
        if file.earlier:
            Path(file.earlier).replace(file.path)
            file.earlier = ""


def settle(files: list[WrittenFile]) -> None:
    """The files of a take are in use: what lay in their places goes."""
    for file in files:
        if file.earlier:
            Path(file.earlier).unlink(missing_ok=True)
            file.earlier = ""


@dataclass
class SolveKeys(Plan):
    """Weights of the artist's `keys` `[K]`, whose displacements are `vectors` `[K, V, 3]` in object
    space; at weight 1 of a shape of `shapes` `[S]` they stand at `factors` `[S, K]`.
    `shown` is the shape that each shows most of."""

    shapes: list[str]
    keys: list[str]
    factors: np.ndarray
    vectors: np.ndarray
    shown: dict[str, str]
    keeps_clip = True

    def finish(self, face, take, engine, progress):
        # Existing keys are those of the face; objects beside it have others.
        vectors = np.tensordot(self.factors, self.vectors, axes=1).astype(np.float32)
        solved = as_made(take, self.shapes)
        if solved is None:
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
    """Weights of the shapes `vectors` `[S, V, 3]` of a face in object space, on the clip where the
    take has one; with `path` they are written there."""
    motion = take.motion
    face_found = finding.find(face, {}, engine.find, progress)
    shapes = names, vectors, face_found.lips(vectors.shape[1])
    if isinstance(motion, ClipMotion):
        return motion.clip.weights(*shapes, motion.way, progress, path, take.fps)
    moved = motion.displacements[:, : vectors.shape[1]]
    return engine.solve(*shapes, moved, progress, path, take.fps)


def as_made(take: Take, shapes: list[str]) -> Solved | None:
    """The weights of `shapes` where the system made them; None where it made none of these."""
    weights = take.shape_weights
    if weights is None or not set(shapes) & set(weights.names):
        return None
    return Solved(weights.of(shapes), weights.left_out(shapes))


def by_key(shapes: list[str], keys: list[str], factors: np.ndarray) -> dict[str, dict[str, float]]:
    """Where each of `keys` `[K]` stands at weight 1 of those of `shapes` `[S]` that it shows."""
    columns = zip(keys, factors.T, strict=True)
    rows = {key: zip(shapes, column, strict=True) for key, column in columns}
    return {key: {shape: float(f) for shape, f in row if f} for key, row in rows.items()}


@dataclass
class MakeKeys(Plan):
    """The ARKit shapes and their weights; with `visemes` these shapes too, without weights."""

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
    """Weights of the ARKit shapes as a table for the object `name`, which waits beside `path`."""

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
    return tuple(Rig(rig.names[part], rig.vectors[part]) for part in (arkit, visemes))


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
