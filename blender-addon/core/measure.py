"""How far the pieces of a face move, measured before a take is written."""

import numpy as np

from .job import Progress
from .take import Frames, Piece, Take

# The number of vertices that are measured at a time.
_BLOCK = 256


def largest(take: Take, pieces: list[Piece], progress: Progress) -> list[float]:
    """The largest displacement of each piece in any frame, mm; raises `Cancelled`.

    The largest of all pieces equals that of the take.
    """
    largest_of = [_largest(take.motion, p.rows, progress) for p in pieces]
    return [take.largest_mm * each / max(*largest_of, 1e-20) for each in largest_of]


def _largest(motion, rows: slice, progress: Progress) -> float:
    """The largest displacement of the vertices `rows` in any frame, object units."""
    if isinstance(motion, Frames):
        frames = motion.displacements
        squares = ((frame[rows] ** 2).sum(axis=1).max(initial=0.0) for frame in frames)
        return max(squares, default=0.0) ** 0.5
    vectors = motion.vectors[:, rows]
    # No vertex moves farther than all its keys move it together, each at its largest weight.
    most = np.abs(motion.weights).max(axis=0, initial=0.0)
    bounds = most @ np.linalg.norm(vectors, axis=2)
    order, best = np.argsort(-bounds), 0.0
    for first in range(0, len(order), _BLOCK):
        some = order[first : first + _BLOCK]
        if bounds[some[0]] <= best:
            break
        progress.check("write", first / len(order))
        flat = np.ascontiguousarray(vectors[:, some]).reshape(len(vectors), -1)
        moved = (motion.weights @ flat).reshape(len(motion.weights), -1, 3)
        best = max(best, float(np.einsum("tvc,tvc->tv", moved, moved).max(initial=0.0)) ** 0.5)
    return best
