"""Converts callers' arguments to the library's types, and says in words which do not fit."""

import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .core import emotion, systems
from .core.errors import AnyfaceError
from .core.events import Reader
from .core.native import LANDMARKS, Engine
from .core.take import EMOTION_WORDS, Request, Sound

Path = str | os.PathLike[str]
MeshLike = Path | tuple[ArrayLike, ArrayLike | Sequence[Sequence[int]]]
"""A file (OBJ, PLY, GLB), or vertices `[V, 3]` and faces: `[F, 3]`, `[F, 4]`, or lists of any length."""
SoundLike = Path | tuple[ArrayLike, float]
"""A file, or samples `[S]` or `[S, C]` and their rate in Hz: floats from -1 to 1, or integers."""
EmotionLike = str | Sequence[tuple[float, str]]
"""`happy:0.7`, a mixture, `auto`, `auto-arousal`, `off`, or a list of `(second, emotion)`."""
FieldLike = float | str | SoundLike
"""A number, a text or a sound, as `systems()` says of each field."""
ControlLike = float | str | tuple[ArrayLike, ArrayLike]
"""A number, the name of a choice, or keys: seconds `[N]` and values `[N]`, linear in between."""

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
Points = tuple[np.ndarray | None, np.ndarray | None]
"""Positions `[68, 3]` and vertex numbers `[68]` of landmarks. At least one of them is None."""
_FIELD_KINDS = systems.NUMBER, systems.TEXT, *systems.PATHS
# With more columns than this the array is transposed: its columns are samples, not channels.
_MAX_CHANNELS = 32


def mesh_of(mesh: MeshLike, engine: Engine) -> Mesh:
    """Positions `[V, 3]` and triangles `[F, 3]`."""
    if isinstance(mesh, str | os.PathLike):
        return engine.read_mesh(os.fspath(mesh))
    vertices, faces = _pair("mesh", mesh, "(vertices, faces)")
    positions = _numbers("vertices", vertices)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise _unfit("vertices", "[V, 3]", positions.shape)
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.shape[1] == 3:
        return positions, _vertex_numbers(faces.ravel(), len(positions)).reshape(-1, 3)
    rows = [np.asarray(face) for face in faces]
    corners = np.concatenate(rows) if rows else np.empty(0, dtype=np.uint32)
    numbers = _vertex_numbers(corners, len(positions))
    return engine.triangulate(positions, [len(row) for row in rows], numbers)


def sound_of(sound: SoundLike, engine: Engine) -> Sound:
    """Mono samples and their rate."""
    if isinstance(sound, str | os.PathLike):
        samples, rate_hz, missing = engine.decode(os.fspath(sound))
        if missing:
            warnings.warn(missing, stacklevel=3)
        return Sound(samples, rate_hz, os.fspath(sound))
    array, rate_hz = _pair("sound", sound, "(samples, rate)")
    samples = _full_scale(np.asarray(array))
    if samples.ndim == 2 and samples.shape[1] <= _MAX_CHANNELS:
        samples = samples.mean(axis=1)
    if samples.ndim != 1:
        raise _unfit("samples", "[S] or [S, C]", samples.shape)
    return Sound(samples, float(rate_hz), "the sound")


def landmarks_of(landmarks: ArrayLike | None) -> Points:
    """Positions `[68, 3]` and vertex numbers `[68]` of landmarks. At least one of them is None."""
    if landmarks is None:
        return None, None
    array = np.asarray(landmarks)
    if array.shape == (LANDMARKS, 3):
        return _numbers("landmarks", array), None
    if array.shape == (LANDMARKS,):
        return None, _vertex_numbers(array, 2**32)
    raise _unfit("landmarks", "positions [68, 3] or vertex numbers [68]", array.shape)


def request_of(
    engine: Engine,
    fps: float,
    emotions: EmotionLike,
    controls: Mapping[str, ControlLike],
    events: Sequence[str],
    fields: Mapping[str, FieldLike],
) -> Request:
    """Builds the request for a performance. The library keeps the clip until all of it is read."""
    request = Request(float(fps), keeps_clip=True)
    for name, field in fields.items():
        request.fields[name] = _field(engine, name, field)
    if events:
        request.events = Reader(engine.models).events("\n".join(events))
    if isinstance(emotions, str) and emotions in EMOTION_WORDS:
        request.fields["emotion"] = emotions
    else:
        rows = [(0.0, emotions)] if isinstance(emotions, str) else emotions
        keys = [(float(second), emotion.parse(text)) for second, text in rows]
        request.fields["emotion"] = keys
    known = {control.name: control for control in engine.controls}
    for name, value in controls.items():
        if name not in known:
            raise _wrong(f"controls: expected some of {', '.join(known)}, got {name!r}")
        _set(request, known[name], value)
    return request


def _field(engine: Engine, name: str, value: Any):
    """The value of a field in the form that a request holds."""
    kinds = {known.name: known.kind for known in engine.fields if known.kind in _FIELD_KINDS}
    if name not in kinds:
        raise _wrong(f"animate: expected its own arguments or {', '.join(kinds)}, got {name!r}")
    if kinds[name] == systems.SOUND:
        return sound_of(value, engine)
    # A number as text keeps all of its digits.
    return str(value)


def _set(request: Request, control: systems.Control, value: ControlLike) -> None:
    if isinstance(value, tuple):
        times, values = (np.asarray(row, dtype=np.float64).ravel() for row in value)
        if not control.is_animatable or len(times) != len(values) or not len(times):
            raise _wrong(
                f"{control.name}: expected as many seconds as values of a control that may change "
                f"over time, got {len(times)} and {len(values)}"
            )
        request.control_keys[control.name] = times, values
    elif isinstance(value, str) and value not in control.choices:
        known = ", ".join(control.choices) or "a number"
        raise _wrong(f"{control.name}: expected one of {known}, got {value!r}")
    else:
        request.controls[control.name] = control.number(value)


def _full_scale(samples: np.ndarray) -> NDArray[np.float32]:
    """Converts integer samples, as wave files hold them, to floats from -1 to 1."""
    if samples.dtype.kind == "i":
        return (samples / -float(np.iinfo(samples.dtype).min)).astype(np.float32)
    if samples.dtype == np.uint8:
        return ((samples - 128.0) / 128.0).astype(np.float32)
    return _numbers("samples", samples)


def _vertex_numbers(values: np.ndarray, count: int) -> NDArray[np.uint32]:
    if values.dtype.kind not in "iu" and len(values):
        raise _wrong(f"vertex numbers: expected whole numbers, got {values.dtype}")
    if len(values) and not 0 <= int(values.min()) <= int(values.max()) < count:
        bounds = f"{values.min()} to {values.max()}"
        raise _wrong(f"vertex numbers: expected 0 to {count - 1}, got {bounds}")
    return np.ascontiguousarray(values, dtype=np.uint32)


def _numbers(what: str, values: ArrayLike) -> NDArray[np.float32]:
    try:
        return np.ascontiguousarray(values, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise _wrong(f"{what}: expected an array of numbers: {error}") from error


def _pair(what: str, pair, expected: str):
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise _wrong(f"{what}: expected a path or {expected}, got {type(pair).__name__}")
    return pair


def _unfit(what: str, expected: str, shape: tuple[int, ...]) -> AnyfaceError:
    return _wrong(f"{what}: expected {expected}, got {list(shape)}")


def _wrong(message: str) -> AnyfaceError:
    return AnyfaceError("input", message)
