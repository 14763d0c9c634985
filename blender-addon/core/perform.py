"""Turns the snapshot of one character into a take. Runs in a worker thread."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from . import basis_names, finding, sliders, sparse, verdict
from .job import Progress
from .take import Animation, ClipMotion, FaceMesh, Frames, Request, Sound, Take

# animate(positions, triangles, landmarks, landmark_vertices, sound, request, progress)
Animate = Callable[..., Animation]


def perform(
    face: FaceMesh, sound: Sound, request: Request, animate: Animate, progress: Progress
) -> Take:
    """Animates `face` and returns the take in object space.

    `animate` is `native.Engine.animate`, or its replacement in a test.
    """
    verdict.check_sound(sound)
    space = face.space
    if (pose := request.fields.get("starts_from")) is not None:
        request = request.with_fields(starts_from=space.moved(pose))
    with finding.searching(face):
        animation = animate(*space.to_library(face), sound, request, progress)
    # Category 0 is neutral.
    emotion = request.fields.get("emotion", ())
    rows = () if isinstance(emotion, str) else emotion
    intensity = max((sum(row[1:]) for _, row in rows), default=0.0)
    verdict.check_seen(animation, sound, intensity)
    progress.check("write")
    motion: Any = animation.basis
    if motion is not None and animation.landmarks is not None and request.named_keys:
        tongue = animation.life.tongue if animation.life is not None else None
        # The names need positions in the space in which the library saw the face.
        positions, *_ = space.to_library(face)
        basis_names.arrange(motion, positions, animation.landmarks.neutral, tongue)
    if animation.clip is not None:
        motion = ClipMotion(animation.clip, space.back)
    elif motion is not None:
        motion.why_missing = sliders.why_missing(request, motion.sliders, motion.offered)
        motion.vectors = space.to_object(motion.vectors)
    elif animation.displacements is not None:
        motion = Frames(space.to_object(animation.displacements))
    take = Take(request.fps, animation.largest_mm, request.output, motion)
    take.shape_weights, take.notes = animation.shape_weights, animation.notes
    take.heard_emotion = animation.heard_emotion
    take.mouth, take.lids = animation.mouth, animation.lids
    # Object units in one unit of the mesh that the library saw.
    scale = abs(float(np.linalg.det(space.back.astype(np.float64)))) ** (1.0 / 3.0)
    if animation.landmarks is not None:
        take.opening = sparse.opening(animation.landmarks, animation.unit_mm)
    take.unit_mm, take.touching = animation.unit_mm / scale, animation.touching
    if animation.life is not None:
        way = space.from_world(face.matrix_world)
        take.life = replace(animation.life, way=animation.life.way @ way)
    return take
