"""Converts callers' arguments to the library's types, and says in words which do not fit."""

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .core import emotion, systems
from .core.arrays import array_of, bytes_of, number_of, path_of
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
_RATES_HZ = 4000.0, 384000.0
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
    rows = [_array("face", face).reshape(-1) for face in _rows("faces", faces)]
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
    samples = _full_scale(_array("samples", array))
    rate_hz, (low, high) = number_of("rate", rate_hz), _RATES_HZ
    if not low <= rate_hz <= high:
        raise AnyfaceError("audio", f"rate: expected {low:g} to {high:g} Hz, got {rate_hz:g}")
    if samples.ndim == 2 and samples.shape[1] <= _MAX_CHANNELS:
        samples = samples.mean(axis=1)
    if samples.ndim != 1:
        raise _unfit("samples", "[S] or [S, C]", samples.shape)
    return Sound(samples, rate_hz, "the sound")


def landmarks_of(landmarks: ArrayLike | None) -> Points:
    """Positions `[68, 3]` and vertex numbers `[68]` of landmarks. At least one of them is None."""
    if landmarks is None:
        return None, None
    array = _array("landmarks", landmarks)
    if array.shape == (LANDMARKS, 3):
        return _numbers("landmarks", array), None
    if array.shape == (LANDMARKS,):
        return None, _vertex_numbers(array, 2**32)
    raise _unfit("landmarks", "positions [68, 3] or vertex numbers [68]", array.shape)


def fixed_of(fixed: Mapping[int, ArrayLike] | None) -> dict[int, NDArray[np.float32]]:
    """Positions `[3]` at which landmarks stay, by number."""
    places = {}
    for number, place in _mapping("fixed", {} if fixed is None else fixed).items():
        if not isinstance(number, int | np.integer) or not 0 <= number < LANDMARKS:
            raise _wrong(f"fixed: expected landmarks from 0 to {LANDMARKS - 1}, got {number!r:.60}")
        places[int(number)] = array_of(f"landmark {number}", place, np.float32, 3)
    return places


def request_of(
    engine: Engine,
    fps: float,
    emotions: EmotionLike,
    controls: Mapping[str, ControlLike],
    events: Sequence[str],
    fields: Mapping[str, FieldLike],
) -> Request:
    """Builds the request for a performance. The library keeps the clip until all of it is read."""
    kinds = {known.name: known for known in engine.fields}
    fps = _within("fps", number_of("fps", fps), kinds["fps"].low, kinds["fps"].high)
    request = Request(fps, keeps_clip=True)
    for name, field in fields.items():
        request.fields[name] = _field(engine, name, field)
    lines = [bytes_of("event", event).decode() for event in _rows("events", events)]
    if lines:
        request.events = Reader(engine.models).events("\n".join(lines))
    if isinstance(emotions, str) and emotions in EMOTION_WORDS:
        request.fields["emotion"] = emotions
    else:
        rows = [(0.0, emotions)] if isinstance(emotions, str) else _rows("emotion", emotions)
        request.fields["emotion"] = [_emotion_key(row) for row in rows]
    known = {control.name: control for control in engine.controls}
    for name, value in _mapping("controls", controls).items():
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
        pair = _pair(control.name, value, "(seconds, values)")
        times, values = (array_of(control.name, row, np.float64).ravel() for row in pair)
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
        number = control.number(value) if isinstance(value, str) else value
        request.controls[control.name] = number_of(control.name, number)


def _emotion_key(row) -> tuple[float, list[float]]:
    second, text = _pair("emotion", row, "(second, emotion)")
    return number_of("emotion", second), emotion.parse(text)


def result_of(out: Path, *inputs: object) -> str:
    """The path of a result, "" for none. It must not replace a file of `inputs`, which may be other
    things than paths."""
    place = path_of(out)
    for read in (path_of(one) for one in inputs if isinstance(one, str | os.PathLike)):
        if os.path.exists(place) and os.path.exists(read) and os.path.samefile(read, place):
            raise _wrong(f"out: expected another file than {os.fsdecode(read)}, which is read")
    return os.fsdecode(place)


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
    return array_of(what, values, np.float32)


def _within(what: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise _wrong(f"{what}: expected {low:g} to {high:g}, got {value:g}")
    return value


def _array(what: str, values: ArrayLike) -> np.ndarray:
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise _wrong(f"{what}: expected an array: {error}") from error


def _mapping(what: str, mapping) -> Mapping:
    if not isinstance(mapping, Mapping):
        raise _wrong(f"{what}: expected a dict, got {type(mapping).__name__}")
    return mapping


def _rows(what: str, rows) -> list:
    """The elements of a sequence, of which a text is none."""
    if isinstance(rows, str | bytes) or not isinstance(rows, Iterable):
        raise _wrong(f"{what}: expected a sequence, got {type(rows).__name__}")
    return list(rows)


def _pair(what: str, pair, expected: str):
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise _wrong(f"{what}: expected a path or {expected}, got {type(pair).__name__}")
    return pair


def _unfit(what: str, expected: str, shape: tuple[int, ...]) -> AnyfaceError:
    return _wrong(f"{what}: expected {expected}, got {list(shape)}")


def _wrong(message: str) -> AnyfaceError:
    return AnyfaceError("input", message)
