"""What is done with a take once the face has moved: nothing, a file, or weights of shapes.

Runs in the worker thread, after `core.perform`.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import pc2, shapes, sliders
from .errors import AnyfaceError
from .job import Progress
from .take import FaceMesh, KeyMotion, Rig, Take, WrittenFile

# Below this share of the motion nobody sees that the artist's keys speak.
_LARGEST_LEFT_OUT = 0.97


@dataclass
class Plan:
    """How a take is to be written.

    `mode` is one of `scene.outputs.MODES`. `paths` are the files of "cache" by object and the one
    of "csv", `ease` the frames in which a cache comes out of rest. "keys" has the artist's `keys`
    by shape name and their `vectors` `[S, V, 3]`, in object space and the same order. `visemes`:
    "arkit" makes these as well.
    """

    mode: str = "basis"
    paths: dict[str, str] = field(default_factory=dict)
    ease: int = 0
    keys: dict[str, str] = field(default_factory=dict)
    vectors: np.ndarray | None = None
    visemes: bool = False

    def finish(self, face: FaceMesh, take: Take, engine, progress: Progress) -> Take:
        """The take as this plan wants it; raises `AnyfaceError`, or `Cancelled`."""
        if self.mode == "basis" and take.basis.sliders:
            take.basis.packed = sliders.pack(take.basis.sliders)
        if self.mode in ("basis", "frames"):
            return take
        finish = {
            "cache": self._cache,
            "keys": self._keys,
            "arkit": self._arkit,
            "csv": self._csv,
        }[self.mode]
        finish(face, take, engine, progress)
        # The largest array of all; what is written needs it no more.
        take.frames = None
        return take

    def _cache(self, face, take, engine, progress) -> None:
        for name, path in self.paths.items():
            rest, moved = of_piece(face, take.frames, name)
            if take.files and not moved.any():
                continue
            pc2.write(Path(path), rest, moved, self.ease, progress)
            take.files.append(WrittenFile(name, path, len(moved), len(rest), self.ease))

    def _keys(self, face, take, engine, progress) -> None:
        # Existing keys are those of the face; objects beside it have others.
        moved = take.frames[:, : self.vectors.shape[1]]
        solved = engine.solve(list(self.keys), self.vectors, moved, progress)
        _check(solved.left_out, face.name)
        take.key_motion = KeyMotion(list(self.keys.values()), solved.weights, solved.left_out)

    def _arkit(self, face, take, engine, progress) -> None:
        rig = make_rig(face, take.space, engine, progress)
        count = len(shapes.ARKIT)
        solved = engine.solve(rig.names[:count], rig.vectors[:count], take.frames, progress)
        motion = KeyMotion(rig.names[:count], solved.weights, solved.left_out, rig.vectors[:count])
        if self.visemes:
            motion.still = Rig(rig.names[count:], rig.vectors[count:])
        take.key_motion = motion

    def _csv(self, face, take, engine, progress) -> None:
        rig = make_rig(face, take.space, engine, progress)
        count = len(shapes.ARKIT)
        names, vectors = rig.names[:count], rig.vectors[:count]
        ((name, path),) = self.paths.items()
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        solved = engine.solve(names, vectors, take.frames, progress, path, take.fps)
        take.files = [WrittenFile(name, path, len(take.frames), left_out=solved.left_out)]


def make_rig(face: FaceMesh, space, engine, progress: Progress) -> Rig:
    """The shapes of a face in object space."""
    landmarks = None if face.landmarks is None else space.points(face.landmarks)
    triangles = face.triangles[:, ::-1] if space.mirrored else face.triangles
    positions = space.points(face.positions)
    given = (landmarks, face.landmark_vertices, face.roles)
    rig = engine.rig(positions, triangles, *given, progress)
    rig.vectors = space.to_object(rig.vectors)
    return rig


def of_piece(face: FaceMesh, moved: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rest `[V, 3]` and motion `[T, V, 3]` of one object of the face, in its own space."""
    piece = next((piece for piece in face.pieces if piece.name == name), None)
    if piece is None or len(face.pieces) == 1:
        return face.positions, moved
    rows = slice(piece.first, piece.first + piece.count)
    back = np.linalg.inv(piece.matrix)
    turn = back[:3, :3].T.astype(np.float32)
    rest = face.positions[rows] @ turn + back[:3, 3].astype(np.float32)
    return rest, moved[:, rows] @ turn


def _check(left_out: float, name: str) -> None:
    if left_out > _LARGEST_LEFT_OUT:
        raise AnyfaceError(
            "nothing_moved",
            f"nothing would move: the keys of {name} show {1.0 - left_out:.0%} of the motion: "
            "check the list of keys, or choose Basis Keys",
        )
