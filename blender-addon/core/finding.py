"""Where a face is: tries the ways in which it may look; in the artist's own space again."""

from collections.abc import Callable

import numpy as np

from . import perform, space
from .errors import AnyfaceError
from .job import Progress
from .take import FaceMesh, Found


def find(
    face: FaceMesh, fixed: dict[int, np.ndarray], find_in: Callable[..., Found], progress: Progress
) -> Found:
    """The landmarks of `face` in object space; `fixed` ones `[3]` by number stay where they are.

    `find_in` is `native.Engine.find`, or what stands in for it in a test. Raises
    `AnyfaceError("face")` where none of the directions shows a face.
    """
    missed = None
    for candidate in space.candidates(face.matrix_world, face.axes):
        try:
            return _find_in(candidate, face, fixed, find_in, progress)
        except AnyfaceError as error:
            if error.kind != "face":
                raise
            missed = missed or error
    raise AnyfaceError("face", perform.face_message(face, missed)) from missed


def _find_in(candidate, face, fixed, find_in, progress) -> Found:
    triangles = face.triangles[:, ::-1] if candidate.mirrored else face.triangles
    landmarks = None if face.landmarks is None else candidate.points(face.landmarks)
    held = {number: candidate.points(place[None])[0] for number, place in fixed.items()}
    positions = candidate.points(face.positions)
    numbers = face.landmark_vertices
    found = find_in(positions, triangles, landmarks, numbers, held, face.roles, progress)
    back = np.linalg.inv(candidate.matrix)
    found.positions = (np.asarray(found.positions, dtype=np.float64) - candidate.offset) @ back.T
    return found
