"""The whole way of one character: snapshot in, take out. Runs in a worker thread."""

from collections.abc import Callable

from . import finding, sliders, space, verdict
from .job import Progress
from .take import Animation, FaceMesh, Performance, Sound, Take

# animate(positions, triangles, landmarks, landmark_vertices, sound, performance, progress)
Animate = Callable[..., Animation]


def perform(
    face: FaceMesh, sound: Sound, performance: Performance, animate: Animate, progress: Progress
) -> Take:
    """Animates `face` and returns the take in object space.

    `animate` is `native.Engine.animate`, or what stands in for it in a test.
    """
    verdict.check_sound(sound)
    found = space.face_space(face.matrix_world, face.axes)
    with finding.naming(face):
        animation = _animate_in(found, face, sound, performance, animate, progress)
    # Category 0 is neutral.
    intensity = max((sum(row[1:]) for _, row in performance.emotion), default=0.0)
    verdict.check_moved(animation.largest_mm, sound, intensity)
    verdict.check_spoken(animation.speech_mm, sound, _articulation(performance))
    progress.check("write")
    take = Take(performance.fps, animation.largest_mm, space=found)
    if animation.basis is None:
        take.frames = found.to_object(animation.displacements)
        return take
    take.basis = animation.basis
    take.basis.why_missing = sliders.why_missing(performance, take.basis.sliders)
    take.basis.vectors = found.to_object(take.basis.vectors)
    return take


def _articulation(performance: Performance) -> float:
    """The articulation, the mean one where it changes."""
    curve = performance.control_keys.get("articulation")
    return float(curve[1].mean()) if curve is not None else performance.controls.articulation


def _animate_in(seen, face, sound, performance, animate, progress) -> Animation:
    landmarks = None if face.landmarks is None else seen.points(face.landmarks)
    triangles = face.triangles[:, ::-1] if seen.mirrored else face.triangles
    positions = seen.points(face.positions)
    return animate(
        positions, triangles, landmarks, face.landmark_vertices, sound, performance, progress
    )
