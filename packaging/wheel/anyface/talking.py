"""The calls that animate a mesh, find its landmarks and make its rig."""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .arguments import (
    ControlLike,
    EmotionLike,
    FieldLike,
    Mesh,
    MeshLike,
    Points,
    SoundLike,
    fixed_of,
    landmarks_of,
    mesh_of,
    request_of,
    result_of,
    sound_of,
)
from .clip import Clip, Weights
from .core import shapes
from .core.errors import AnyfaceError
from .core.job import Job
from .core.job import Progress as Watch
from .core.native import Engine
from .core.take import Animation, Found, Rig, Sound

Progress = Callable[[str, float], object]
"""Called several times a second with the stage of the work and its done share, 0 to 1."""
Cancel = Callable[[], bool]
"""Called several times a second. If it returns True, the call raises `Cancelled`."""
Made = TypeVar("Made")
# Seconds between two calls of `progress` and `cancel`.
_PERIOD_S = 0.05


def animate(
    mesh: MeshLike,
    sound: SoundLike,
    *,
    fps: float = 30.0,
    emotion: EmotionLike = "neutral",
    controls: Mapping[str, ControlLike] | None = None,
    events: Sequence[str] = (),
    landmarks: ArrayLike | None = None,
    weights: bool = False,
    out: str | os.PathLike[str] = "",
    forward: str = "+z",
    up: str = "+y",
    engine: Engine | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
    **fields: FieldLike,
) -> Clip:
    """Makes a mesh say what a sound says.

    `mesh` is a file or `(vertices, faces)` in any units, `sound` a file or `(samples, rate_hz)`. The
    68 landmarks are found automatically unless you give them as positions `[68, 3]` or vertex
    numbers `[68]`. `forward` and `up` say how the head is oriented. A head in any other orientation
    is found too, but these axes decide if several places look like a face.

    `controls` are those that `systems()` lists. `events` are texts such as `1.2-2.0:left wink:0.8`,
    for systems that show them. `fields` are the numbers, texts, files and sounds that `systems()`
    lists: `seed=3`, `text="Hello there."` for the words that are spoken, `style="name"` for a speaker,
    `neutral_voice="calm.wav"` for the same person's neutral speech. With `weights` the motion is
    also solved into ARKit weights. `out` is a file that also receives the take on the mesh's ARKit
    shapes: .glb, .usda, or .vrma, which moves any VRM avatar. Pass an `engine` to use other models
    than the built-in ones.

    `progress` and `cancel` are called in the caller's own thread. Raises `AnyfaceError`, whose `kind`
    says what was wrong, or `Cancelled`.
    """
    oriented = _facing(engine, forward, up)
    request = request_of(oriented, fps, emotion, {} if controls is None else controls, events, fields)
    points = landmarks_of(landmarks)
    others = (field.name for field in request.fields.values() if isinstance(field, Sound))
    out = result_of(out, mesh, sound, *others)

    def work(watch: Watch) -> Clip:
        arrays, speech = mesh_of(mesh, oriented), sound_of(sound, oriented)
        animation = oriented.animate(*arrays, *points, speech, request, watch)
        if out:
            oriented.write_take(*arrays, *points, None, animation.clip, out, watch)
        solved = _solved(oriented, arrays, points, animation, watch) if weights else None
        return _clip(request.fps, arrays, animation, solved)

    return _run(work, progress, cancel)


def learn_performer(
    takes: Sequence[tuple[str | os.PathLike[str], str | os.PathLike[str]]],
    out: str | os.PathLike[str],
    *,
    engine: Engine | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> dict[str, Any]:
    """Learns how a person speaks, and writes a file for `animate(…, performer=out)`.

    `takes` are pairs of files: a sound, and the motion of the face that spoke it, from the start of
    the sound on: a .csv of Live Link Face, or an .npz of landmarks or weights. Fifteen seconds or
    more in all. Returns the card of the performer: how well it follows the person on parts that were
    left out, with and without it.
    """
    learner = engine or built_in()

    def work(watch: Watch) -> dict[str, Any]:
        return learner.learn_performer(takes, os.fspath(out), watch)

    return _run(work, progress, cancel)


def find_landmarks(
    mesh: MeshLike,
    *,
    landmarks: ArrayLike | None = None,
    fixed: Mapping[int, ArrayLike] | None = None,
    forward: str = "+z",
    up: str = "+y",
    engine: Engine | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Found:
    """Finds where the face of a mesh is, how its lips meet and what its parts are.

    `fixed` maps landmark numbers, 0 to 67, to positions `[3]`. These landmarks stay there, and the
    others follow. The other arguments are those of `animate`.
    """
    oriented, points = _facing(engine, forward, up), landmarks_of(landmarks)
    fixed_points = fixed_of(fixed)

    def work(watch: Watch) -> Found:
        return oriented.find(*mesh_of(mesh, oriented), *points, fixed_points, None, watch)

    return _run(work, progress, cancel)


def make_rig(
    mesh: MeshLike,
    *,
    landmarks: ArrayLike | None = None,
    out: str | os.PathLike[str] = "",
    forward: str = "+z",
    up: str = "+y",
    engine: Engine | None = None,
    progress: Progress | None = None,
    cancel: Cancel | None = None,
) -> Rig:
    """Makes a mesh's 52 ARKit shapes and 15 Oculus visemes: `vectors` `[67, V, 3]` and `names`.

    `out` is a file that also receives them, .npz, .glb or .vrm. The .glb is the mesh with its shapes
    as morph targets, the .vrm an avatar with the expressions of VRM and of Perfect Sync. Both keep
    everything else that the file `mesh` has. The other arguments are those of `animate`.
    """
    oriented, points = _facing(engine, forward, up), landmarks_of(landmarks)
    source = os.fspath(mesh) if isinstance(mesh, str | os.PathLike) else ""
    out = result_of(out, mesh)

    def work(watch: Watch) -> Rig:
        arrays = mesh_of(mesh, oriented)
        return oriented.rig(*arrays, *points, None, watch, path=out, source=source)

    return _run(work, progress, cancel)


@cache
def built_in() -> Engine:
    """The built-in models, loaded at the first use."""
    return Engine()


def _facing(engine: Engine | None, forward: str, up: str) -> Engine:
    if not isinstance(engine, Engine | None):
        raise AnyfaceError("input", f"engine: expected an Engine, got {type(engine).__name__}")
    return (built_in() if engine is None else engine).facing(forward, up)


def _run(work: Callable[[Watch], Made], progress: Progress | None, cancel: Cancel | None) -> Made:
    """Runs `work` in a thread. If `progress` or `cancel` raises, the work stops too."""
    job = Job(work).start()
    try:
        while not job.wait(_PERIOD_S):
            if progress is not None:
                progress(*job.progress.at)
            if cancel is not None and cancel():
                job.cancel()
    except BaseException:
        # Ctrl-C comes here too: the library must not go on after a notebook was stopped.
        job.cancel(wait_s=None)
        raise
    return job.result()


def _solved(engine: Engine, mesh: Mesh, landmarks: Points, animation: Animation, watch: Watch) -> Weights:
    rig, count = engine.rig(*mesh, *landmarks, None, watch), len(shapes.ARKIT)
    names, vectors = rig.names[:count], rig.vectors[:count]
    lips = engine.find(*mesh, *landmarks, {}, None, watch).lips(vectors.shape[1])
    solved = animation.clip.weights(names, vectors, lips, np.eye(3), watch)
    return Weights(tuple(names), solved.weights, solved.left_out)


def _clip(fps: float, mesh: Mesh, animation: Animation, weights: Weights | None) -> Clip:
    landmarks, life = animation.landmarks, animation.life
    # Every animation of an engine has these.
    assert landmarks is not None and life is not None and life.tongue is not None
    return Clip(
        fps=fps,
        rest=mesh[0],
        triangles=mesh[1],
        displacements=animation.clip.displacements(),
        landmarks=landmarks.neutral,
        landmark_displacements=landmarks.displacements,
        head=life.head,
        gaze=life.gaze,
        tongue=life.tongue,
        largest_mm=animation.largest_mm,
        speaks=animation.visibility == "SPEAKS",
        weights=weights,
        heard_emotion=animation.heard_emotion,
    )
