"""Finds where a face is, in the artist's own space, and says what may be wrong if there is none."""

import hashlib
from collections.abc import Callable
from contextlib import contextmanager

import numpy as np

from .errors import AnyfaceError
from .job import Progress
from .take import FaceMesh, Found

# The error messages of meshes in which no face was found, by digest.
_failed: dict[str, str] = {}


def find(
    face: FaceMesh, fixed: dict[int, np.ndarray], find_in: Callable[..., Found], progress: Progress
) -> Found:
    """The landmarks of `face` in object space; `fixed` ones `[3]` by number stay where they are.

    `find_in` is `native.Engine.find`, or a stand-in in a test. Raises `AnyfaceError("face")` if
    there is no face.
    """
    space = face.space
    fixed_points = {number: space.points(place[None])[0] for number, place in fixed.items()}
    with naming(face) if fixed_points else searching(face):
        face_found = find_in(*space.to_library(face), fixed_points, face.roles, progress)
    face_found.positions = space.points_to_object(face_found.positions)
    return face_found


@contextmanager
def searching(face: FaceMesh):
    """As `naming`; a mesh in which no face was found fails again at once, without a search."""
    key = digest(face)
    with naming(face):
        if key in _failed:
            raise AnyfaceError("face", _failed[key])
        try:
            yield
        except AnyfaceError as error:
            if error.kind == "face":
                _failed[key] = str(error)
            raise


def digest(face: FaceMesh) -> str:
    """A digest of everything that a search depends on."""
    digest = hashlib.blake2b(face.axes.encode(), digest_size=12)
    roles = face.roles
    role_arrays = [] if roles is None else [roles.object_of_vertex, roles.object_roles]
    role_arrays += [] if roles is None else [roles.numbers, roles.number_roles]
    for values in (face.positions, face.triangles, face.matrix_world, *role_arrays):
        digest.update(np.ascontiguousarray(values).tobytes())
    for values in (face.landmarks, face.landmark_vertices):
        digest.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


@contextmanager
def naming(face: FaceMesh):
    """Adds the mesh's name and possible reasons to the error that no face was found."""
    try:
        yield
    except AnyfaceError as error:
        if error.kind != "face":
            raise
        hints = "".join(f"{hint}. " for hint in face.hints)
        mirrored = ("apply_mirror",) if any("Mirror" in hint for hint in face.hints) else ()
        text = f"{face.name}: {hints}{error}. Place Points asks for the five"
        mends = ("place_points", "direction", "points_file", *mirrored)
        raise AnyfaceError("face", text, mends) from error
