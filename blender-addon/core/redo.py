"""Redoes a stretch of a finished take with the keys that the take has; the rest stays."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import finding, plan
from .errors import AnyfaceError
from .job import Progress
from .take import FaceMesh, Life

# At either end the old motion blends into the new one for at most this many seconds, and for at
# most this share of the stretch, as in `anyface_motion_new_redone`.
_BLEND_S, _BLEND_PART = 0.1, 0.25
# Least squares do not bound the farthest vertex: it may miss by this many times a take's error.
_ROOM = 1.5
# If the keys of a take cannot show the motion of a stretch, at most this many are added.
_MAX_MORE = 32


@dataclass
class ObjectKeys:
    """Keys of a take on one object, with `vectors` `[K, V, 3]` in the object's space. `shapes`
    `[K]` names the shape that each key shows most of.

    Keys that are `free` have weights of both signs, and more keys may be added. For other keys
    `factors` `[K]` gives the value of each at weight 1 of each shape that it shows.
    """

    name: str
    shapes: list[str]
    vectors: np.ndarray
    free: bool
    factors: list[dict[str, float]] = field(default_factory=list)

    def by_shape(self) -> tuple[list[str], np.ndarray]:
        """The shapes that the keys show `[S]`, and how far each moves each key, `[S, K]`."""
        factors_of_keys = self.factors or [{shape: 1.0} for shape in self.shapes]
        names = list(dict.fromkeys(shape for factors in factors_of_keys for shape in factors))
        rows = [[factors.get(shape, 0.0) for factors in factors_of_keys] for shape in names]
        return names, np.array(rows, dtype=np.float32).reshape(len(names), len(factors_of_keys))


@dataclass
class Fit:
    """New `weights` `[n, K]` for the keys of one object. `more` `[M, V, 3]` are added keys with
    `more_weights` `[n, M]`. `left_out` is the share of the motion that is not shown."""

    weights: np.ndarray
    more: np.ndarray
    more_weights: np.ndarray
    left_out: float


@dataclass
class Redone:
    """The result for a stretch: a `Fit` for each object by name, head and eyes, `[n]` frames.

    `unit_mm` is the length of an object unit on a head of human size.
    """

    fits: dict[str, Fit]
    life: Life | None
    frames: int
    unit_mm: float


@dataclass
class Stretch:
    """Scene frames to redo: those between `first` and `last`, which themselves stay as they are.

    `begins` and `ends` are the first and the last frame of the take. An end of the stretch that
    reaches past them is not blended.
    """

    first: float
    last: float
    begins: float
    ends: float
    fps: float

    def shares(self, frames: np.ndarray) -> np.ndarray:
        """The share of the new motion in each of the scene frames, 0 to 1."""
        length = self.last - self.first
        blend = min(_BLEND_S * self.fps, _BLEND_PART * length)
        before = np.clip((frames - self.first) / blend, 0.0, 1.0)
        after = np.clip((self.last - frames) / blend, 0.0, 1.0)
        before = np.where(self.first <= self.begins, frames >= self.begins, before)
        after = np.where(self.last > self.ends, frames <= self.ends, after)
        x = np.minimum(before, after)
        return x * x * (3.0 - 2.0 * x)

    def of_keyframes(self, frames: np.ndarray) -> np.ndarray:
        """The same for keyframes `[n]` in rising order, with linear motion between them.

        A keyframe with a neighbour outside the stretch stays: changing it would move frames there.
        """
        shares = self.shares(frames.astype(np.float64))
        inside = np.flatnonzero(shares > 0.0)
        if len(inside) == 0:
            return shares
        first, last = inside[0], inside[-1]
        if first > 0 and self.first > self.begins and frames[first - 1] < self.first:
            shares[first] = 0.0
        if last + 1 < len(frames) and self.last <= self.ends and frames[last + 1] > self.last:
            shares[last] = 0.0
        return shares


@dataclass
class Redo:
    """The job of the worker thread; `snapshot` is a `scene.bake.Snapshot`, `rows` are the frames
    of the take that it needs."""

    snapshot: Any
    rows: range
    keys: list[ObjectKeys] = field(default_factory=list)

    def work(self, progress: Progress) -> Redone:
        """The new weights; raises `AnyfaceError`, or `Cancelled`."""
        snapshot = self.snapshot
        take = snapshot.perform(progress, self.rows)
        frames = take.motion.displacements
        largest = np.sqrt((frames**2).sum(axis=2).max(initial=0.0))
        per_mm = float(largest) / max(take.largest_mm, 1e-9)
        limit = _ROOM * snapshot.settings.error_mm * per_mm
        stretches = {}
        for keys in self.keys:
            _, moved = plan.of_piece(snapshot.face, frames, keys.name)
            if not snapshot.face.stands_in:
                moved = moved[:, : keys.vectors.shape[1]]
            if keys.free:
                stretches[keys.name] = fit(keys.vectors, moved, limit)
                continue
            shapes, factors = keys.by_shape()
            solved = plan.as_made(take, shapes)
            if solved is None:
                face, own = snapshot.face, (factors, keys.vectors)
                vectors = plan.shape_vectors(face, shapes, *own, snapshot.engine, progress)
                face_found = finding.find(face, {}, snapshot.engine.find, progress)
                lips = face_found.lips(vectors.shape[1])
                solved = snapshot.engine.solve(shapes, vectors, lips, moved, progress)
            weights = np.clip(solved.weights @ factors, 0.0, 1.0)
            none = np.empty((0, *moved.shape[1:])), np.empty((len(moved), 0))
            stretches[keys.name] = Fit(weights, *none, solved.left_out)
        return Redone(stretches, take.life, len(frames), 1.0 / max(per_mm, 1e-12))


def fit(vectors: np.ndarray, moved: np.ndarray, limit: float) -> Fit:
    """Finds weights by least squares, and adds vectors until every vertex is within `limit`.

    `moved` `[n, V, 3]` is the motion. The added vectors are the largest components of the motion
    that is left (singular value decomposition); their weights are within -1..1.
    """
    shapes = vectors.reshape(len(vectors), -1).astype(np.float64)
    motion = moved.reshape(len(moved), -1).astype(np.float64)
    gram = shapes @ shapes.T
    weights = np.linalg.lstsq(gram, shapes @ motion.T, rcond=1e-10)[0].T
    left = motion - weights @ shapes
    missing = float(np.linalg.norm(left)) / max(float(np.linalg.norm(motion)), 1e-20)
    pieces: list[tuple[np.ndarray, np.ndarray]] = []
    while _farthest(left) > limit and len(pieces) < min(_MAX_MORE, len(motion)):
        _, columns = np.linalg.eigh(left @ left.T)
        column = columns[:, -1]
        peak = np.abs(column).max()
        vector = (column @ left) * peak
        column = column / peak
        left = left - np.outer(column, vector)
        pieces.append((vector.reshape(moved.shape[1:]), column))
        missing = float(np.linalg.norm(left)) / max(float(np.linalg.norm(motion)), 1e-20)
    more = np.array([vector for vector, _ in pieces]).reshape(-1, *moved.shape[1:])
    more_weights = np.array([column for _, column in pieces]).reshape(-1, len(moved)).T
    return Fit(weights, more, more_weights, missing)


def rows_of(stretch: Stretch, start: float, step: float) -> range:
    """The frames of a take in a stretch, and one beyond each end.

    The take begins at scene frame `start`; its frames are `step` apart. Raises
    `AnyfaceError("input")` if none of them lies in the stretch.
    """
    first, last = (stretch.first - start) / step, (stretch.last - start) / step
    length = (stretch.ends - start) / step
    if last <= 0.0 or first >= length or last - first <= 1.0:
        raise AnyfaceError(
            "input",
            f"expected a stretch of frames {stretch.begins:g} to {stretch.ends:g}, where the sound "
            f"is, got {stretch.first:g} to {stretch.last:g}",
        )
    return range(max(0, int(np.floor(first))), int(np.ceil(last)) + 1)


def moved_by(keys: ObjectKeys, change: np.ndarray) -> float:
    """How far a change `[n, K]` of weights moves the farthest vertex, in object units."""
    flat = keys.vectors.reshape(len(keys.vectors), -1)
    return _farthest(change.astype(np.float32) @ flat)


def is_of(face: FaceMesh, name: str) -> bool:
    """True if the object `name` is part of a face."""
    return name in [piece.name for piece in face.pieces]


def _farthest(left: np.ndarray) -> float:
    """The largest length of the vectors of `left` `[n, V * 3]`."""
    vectors = left.reshape(len(left), -1, 3)
    return float(np.sqrt((vectors**2).sum(axis=2).max(initial=0.0)))
