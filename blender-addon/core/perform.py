"""The whole way of one character: snapshot in, take out. Runs in a worker thread."""

from collections.abc import Callable
from dataclasses import replace

from . import finding, sliders, space, verdict
from .job import Progress
from .take import Animation, FaceMesh, Request, Sound, Take

# animate(positions, triangles, landmarks, landmark_vertices, sound, request, progress)
Animate = Callable[..., Animation]


def perform(
    face: FaceMesh, sound: Sound, request: Request, animate: Animate, progress: Progress
) -> Take:
    """Animates `face` and returns the take in object space.

    `animate` is `native.Engine.animate`, or what stands in for it in a test.
    """
    verdict.check_sound(sound)
    found = space.face_space(face.matrix_world, face.axes)
    if request.starts_from is not None:
        request = replace(request, starts_from=found.moved(request.starts_from))
    with finding.searching(face):
        animation = animate(*found.seen(face), sound, request, progress)
    # Category 0 is neutral.
    intensity = max((sum(row[1:]) for _, row in request.emotion), default=0.0)
    verdict.check_seen(animation, sound, intensity)
    progress.check("write")
    take = Take(request.fps, animation.largest_mm, space=found)
    take.shape_weights, take.notes = animation.shape_weights, animation.notes
    if animation.life is not None:
        way = found.from_world(face.matrix_world)
        take.life = replace(animation.life, way=animation.life.way @ way)
    take.clip = animation.clip
    if animation.displacements is not None:
        take.frames = found.to_object(animation.displacements)
    if animation.basis is None:
        return take
    take.basis = animation.basis
    take.basis.why_missing = sliders.why_missing(request, take.basis.sliders, take.basis.offered)
    take.basis.vectors = found.to_object(take.basis.vectors)
    return take
