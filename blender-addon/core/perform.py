"""The whole way of one character: snapshot in, take out. Runs in a worker thread."""

from collections.abc import Callable

import numpy as np

from . import basis, space, verdict
from .errors import AnyfaceError
from .job import Progress
from .take import Animation, FaceMesh, Performance, Sound, Take

# animate(positions, triangles, landmarks, landmark_vertices, sound, performance, progress)
Animate = Callable[..., Animation]


def perform(
    face: FaceMesh,
    sound: Sound,
    performance: Performance,
    mode: str,
    error_mm: float,
    animate: Animate,
    progress: Progress,
) -> Take:
    """Animates `face` and returns the take in object space.

    `mode` is "basis" or "frames"; `error_mm` is the largest error of the basis. `animate` is
    `native.Engine.animate` or the same function of a test.
    """
    verdict.check_sound(sound)
    found, animation = _animate_any(face, sound, performance, animate, progress)
    mm_per_unit = animation.metres_per_unit * 1000.0
    largest_mm = largest_motion(animation.displacements) * mm_per_unit
    # Category 0 is neutral.
    intensity = max((sum(row[1:]) for _, row in performance.emotion), default=0.0)
    verdict.check_moved(largest_mm, sound, intensity)
    progress.check("basis" if mode == "basis" else "frames")
    if mode == "frames":
        frames = found.to_object(animation.displacements)
        return Take(performance.fps, largest_mm, frames=frames)
    packed = basis.compress(animation.displacements, mm_per_unit, error_mm)
    packed.vectors = found.to_object(packed.vectors)
    progress.check("basis", 1.0)
    return Take(performance.fps, largest_mm, basis=packed)


def largest_motion(displacements: np.ndarray) -> float:
    """The longest displacement of `[T, V, 3]`, in its own units."""
    squared = np.einsum("tvc,tvc->tv", displacements, displacements)
    return float(squared.max(initial=0.0)) ** 0.5


def _animate_any(face, sound, performance, animate, progress):
    """Tries the ways in which the face may look; the first in which a face is found wins."""
    missed = None
    for candidate in space.candidates(face.matrix_world, face.axes):
        try:
            return candidate, _animate_in(candidate, face, sound, performance, animate, progress)
        except AnyfaceError as error:
            if error.kind != "face":
                raise
            missed = missed or error
    raise AnyfaceError("face", _face_message(face, missed)) from missed


def _animate_in(candidate, face, sound, performance, animate, progress) -> Animation:
    landmarks = None if face.landmarks is None else candidate.points(face.landmarks)
    triangles = face.triangles[:, ::-1] if candidate.mirrored else face.triangles
    positions = candidate.points(face.positions)
    return animate(
        positions, triangles, landmarks, face.landmark_vertices, sound, performance, progress
    )


def _face_message(face: FaceMesh, error: AnyfaceError) -> str:
    hints = "".join(f" {hint}." for hint in face.hints)
    return (
        f"{face.name}: {error}.{hints} The head should be upright and face -Y in the world or in "
        "its own space; or give the 68 landmarks in the custom property anyface_landmarks"
    )
