"""The native library through ctypes: one table of functions, one class.

The table follows `include/anyface.h`; a test compares the two. ctypes releases Python's lock
during a call, so the interface of Blender goes on while a thread waits here.
"""

import ctypes
import os
import sys
from contextlib import ExitStack
from ctypes import (
    POINTER,
    Structure,
    byref,
    c_char_p,
    c_double,
    c_float,
    c_int32,
    c_size_t,
    c_uint32,
    c_uint64,
    c_void_p,
)
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from . import sweep, verdict
from .errors import AnyfaceError, Cancelled
from .job import Progress
from .native_shapes import SIGNATURES as SHAPE_SIGNATURES
from .native_shapes import ShapeCalls
from .native_sliders import SIGNATURES as SLIDER_SIGNATURES
from .native_sliders import SliderCalls
from .take import EMOTION_SOURCES, MOUTHS, Animation, Basis, Found, PartRoles, Performance, Sound

ABI_VERSION = 1
LANDMARKS = 68
# Static weights over 68 landmarks give motion of rank 204 at most.
MAX_VECTORS = 256
# Blender's axes as `AnyfaceAxis`: heads face -Y with +Z up.
_NEG_Y, _POS_Z = 3, 4
# Samples of a decoded sound are mono at this rate.
_DECODED_RATE_HZ = 16000.0
_CANCELLED = 9
# `ANYFACE_CACHE_FOLDER`.
_CACHE_IN_FOLDER = 2
_KINDS = {3: "input", 4: "audio", 5: "mesh", 6: "face", 7: "weights", 8: "file"}


class EngineOptions(Structure):
    """`AnyfaceEngineOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("weights_dir", c_char_p),
        ("speech_dir", c_char_p),
        ("cache_dir", c_char_p),
        ("cache", c_int32),
        ("decoder", c_int32),
        ("threads", c_uint32),
        ("reserved", c_uint32),
    ]


class FaceOptions(Structure):
    """`AnyfaceFaceOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("landmark_positions", POINTER(c_float)),
        ("landmark_vertices", POINTER(c_uint32)),
        ("landmark_json", c_char_p),
        ("forward", c_int32),
        ("up", c_int32),
        ("learned", c_float),
        ("reserved", c_uint32),
        ("part_numbers", POINTER(c_uint32)),
        ("part_roles", POINTER(c_int32)),
        ("part_count", c_size_t),
        ("fixed_numbers", POINTER(c_uint32)),
        ("fixed_positions", POINTER(c_float)),
        ("fixed_count", c_size_t),
        ("object_of_vertex", POINTER(c_uint32)),
        ("object_vertex_count", c_size_t),
        ("object_roles", POINTER(c_int32)),
        ("object_count", c_size_t),
    ]


class MotionOptions(Structure):
    """`AnyfaceMotionOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("emotion_strengths", POINTER(c_float)),
        ("emotion_times_s", POINTER(c_double)),
        ("emotion_count", c_size_t),
        ("fps", c_double),
        ("seed", c_uint64),
        ("style", c_char_p),
        ("steps", c_uint32),
        ("reserved", c_uint32),
        ("emotion_source", c_int32),
        ("articulation", c_float),
        ("jaw_lips", c_float),
        ("smoothing_s", c_float),
        ("upper_face", c_float),
        ("blinks_per_minute", c_float),
        ("brow_accents", c_float),
        ("asymmetry", c_float),
    ]


_FLOATS, _INDICES = POINTER(c_float), POINTER(c_uint32)
_HANDLE, _OUT = c_void_p, POINTER(c_void_p)

# Name: what it returns, what it takes. Handles are untyped pointers.
SIGNATURES = {
    "anyface_abi_version": (c_uint32, []),
    "anyface_version": (c_char_p, []),
    "anyface_emotion_name": (c_char_p, [c_size_t]),
    "anyface_error_message": (c_char_p, [_HANDLE]),
    "anyface_error_free": (None, [_HANDLE]),
    "anyface_engine_options_init": (c_int32, [POINTER(EngineOptions), c_size_t]),
    "anyface_engine_new": (c_int32, [POINTER(EngineOptions), _OUT, _OUT]),
    "anyface_engine_free": (None, [_HANDLE]),
    "anyface_audio_new": (c_int32, [_FLOATS, c_size_t, c_uint32, c_uint32, _OUT, _OUT]),
    "anyface_audio_read": (c_int32, [c_char_p, _OUT, _OUT]),
    "anyface_audio_sample_count": (c_size_t, [_HANDLE]),
    "anyface_audio_copy_samples": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_audio_free": (None, [_HANDLE]),
    "anyface_mesh_new": (c_int32, [_FLOATS, c_size_t, _INDICES, c_size_t, _OUT, _OUT]),
    "anyface_mesh_free": (None, [_HANDLE]),
    "anyface_face_options_init": (c_int32, [POINTER(FaceOptions), c_size_t]),
    "anyface_face_new": (
        c_int32,
        [_HANDLE, _HANDLE, POINTER(FaceOptions), _HANDLE, _OUT, _OUT],
    ),
    "anyface_face_free": (None, [_HANDLE]),
    "anyface_landmarks_new": (
        c_int32,
        [_HANDLE, _HANDLE, POINTER(FaceOptions), _HANDLE, _OUT, _OUT],
    ),
    "anyface_landmarks_copy": (c_int32, [_HANDLE, _FLOATS, _INDICES, _FLOATS, _OUT]),
    "anyface_landmarks_mouth": (c_int32, [_HANDLE]),
    "anyface_landmarks_part_count": (c_size_t, [_HANDLE]),
    "anyface_landmarks_copy_parts": (c_int32, [_HANDLE, POINTER(c_int32), _INDICES, _OUT]),
    "anyface_landmarks_free": (None, [_HANDLE]),
    "anyface_motion_options_init": (c_int32, [POINTER(MotionOptions), c_size_t]),
    "anyface_motion_new": (
        c_int32,
        [_HANDLE, _HANDLE, POINTER(MotionOptions), _HANDLE, _OUT, _OUT],
    ),
    "anyface_motion_new_displacements": (
        c_int32,
        [_FLOATS, c_size_t, c_double, _OUT, _OUT],
    ),
    "anyface_motion_frame_count": (c_size_t, [_HANDLE]),
    "anyface_motion_copy_displacements": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_motion_free": (None, [_HANDLE]),
    "anyface_clip_new": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_clip_copy_displacements": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_copy_landmark_displacements": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_free": (None, [_HANDLE]),
    "anyface_clip_largest_displacement": (c_float, [_HANDLE]),
    "anyface_basis_new": (c_int32, [_HANDLE, c_float, c_size_t, _HANDLE, _OUT, _OUT]),
    "anyface_basis_shape_count": (c_size_t, [_HANDLE]),
    "anyface_basis_max_error": (c_float, [_HANDLE]),
    "anyface_basis_copy_shapes": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_basis_copy_weights": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_basis_free": (None, [_HANDLE]),
    "anyface_progress_new": (_HANDLE, [c_void_p, c_void_p]),
    "anyface_progress_read": (c_int32, [_HANDLE, POINTER(c_char_p), _FLOATS]),
    "anyface_progress_cancel": (None, [_HANDLE]),
    "anyface_progress_free": (None, [_HANDLE]),
    "anyface_rig_new": (
        c_int32,
        [_HANDLE, _HANDLE, POINTER(FaceOptions), _HANDLE, _OUT, _OUT],
    ),
    **SHAPE_SIGNATURES,
    **SLIDER_SIGNATURES,
}


def library_path() -> Path:
    """The library in `lib` of the extension; `ANYFACE_LIBRARY` names another one."""
    given = os.environ.get("ANYFACE_LIBRARY")
    names = {"win32": "anyface.dll", "darwin": "libanyface.dylib"}
    name = names.get(sys.platform, "libanyface.so")
    return Path(given) if given else Path(__file__).resolve().parents[1] / "lib" / name


def load(path: Path) -> ctypes.CDLL:
    """The library with its functions declared; raises `AnyfaceError("weights")`."""
    try:
        library = ctypes.CDLL(str(path))
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise AnyfaceError("weights", f"the native library cannot be used: {error}") from error
    found = library.anyface_abi_version()
    if found != ABI_VERSION:
        raise AnyfaceError(
            "weights", f"{path}: expected interface {ABI_VERSION}, got {found}: install it again"
        )
    return library


class Engine(ShapeCalls, SliderCalls):
    """Loaded weights; any number of threads may use one engine."""

    def __init__(self, threads: int = 0, path: Path | None = None, cache: Path | None = None):
        """Loads the weights; `cache` is the folder for work that depends on a mesh alone, else
        the user's own cache folder is taken."""
        self._library = load(path or library_path())
        options = self._options(EngineOptions, "anyface_engine_options_init")
        options.threads = threads
        if cache is not None:
            options.cache, options.cache_dir = _CACHE_IN_FOLDER, os.fsencode(cache)
        self._handle = self._make("anyface_engine_new", byref(options))

    def close(self) -> None:
        """Frees the weights."""
        handle, self._handle = self._handle, None
        self._library.anyface_engine_free(handle)

    def emotions(self) -> list[str]:
        """The names of the emotions, in the order of the weights."""
        names = []
        while (name := self._library.anyface_emotion_name(len(names))) is not None:
            names.append(name.decode())
        return names

    def decode(self, path: str) -> tuple[np.ndarray, float]:
        """Mono samples `[S]` float32 of a sound file, and their rate in Hz."""
        with ExitStack() as handles:
            audio = self._own(handles, "audio", "anyface_audio_read", os.fsencode(path))
            count = self._library.anyface_audio_sample_count(audio)
            samples = np.empty(count, dtype=np.float32)
            self._copy("anyface_audio_copy_samples", audio, samples)
        return samples, _DECODED_RATE_HZ

    def animate(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        performance: Performance,
        progress: Progress,
    ) -> Animation:
        """The whole way for one mesh that faces -Y with +Z up, in any units.

        `positions` `[V, 3]` float32, `triangles` `[F, 3]` uint32, `landmarks` `[68, 3]` or
        `landmark_vertices` `[68]` or neither. Raises `AnyfaceError`, or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(_Watch(self._library, progress))
            face = self._face(
                handles, positions, triangles, landmarks, landmark_vertices, performance, watch
            )
            motion = self._performed(handles, sound, performance, watch)
            clip = self._own(
                handles, "clip", "anyface_clip_new", self._handle, face, motion, watch.handle
            )
            frames = self._library.anyface_motion_frame_count(motion)
            mm_per_unit = 1000.0 * self._metres_per_unit(motion, clip)
            largest = self._library.anyface_clip_largest_displacement(clip)
            animation = Animation(largest * mm_per_unit)
            animation.speech_mm = verdict.speech_mm(self._displacements(motion))
            shape = (frames, len(positions), 3)
            if performance.error_mm is not None:
                limit = performance.error_mm / mm_per_unit
                made = (face, motion, clip)
                animation.basis = self._basis(handles, made, shape, limit, watch)
                animation.basis.error_mm *= mm_per_unit
            else:
                animation.displacements = np.empty(shape, dtype=np.float32)
                self._copy("anyface_clip_copy_displacements", clip, animation.displacements)
            return animation

    def find(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        fixed: dict[int, np.ndarray],
        roles: PartRoles | None,
        progress: Progress,
    ) -> Found:
        """The landmarks of a mesh that faces -Y with +Z up, how its lips meet, and its parts.

        `fixed` are landmarks `[3]` by number that stay there while the others follow; the rest as
        for `animate`. Raises `AnyfaceError`, or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(_Watch(self._library, progress))
            mesh = self._mesh(handles, positions, triangles)
            options, _alive = self._face_options(landmarks, landmark_vertices, roles, fixed)
            given = (self._handle, mesh, byref(options), watch.handle)
            found = self._own(handles, "landmarks", "anyface_landmarks_new", *given)
            return self._found(found, len(positions))

    def _found(self, handle, vertex_count: int) -> Found:
        places = np.empty((LANDMARKS, 3), dtype=np.float32)
        vertices = np.empty(LANDMARKS, dtype=np.uint32)
        sure = np.empty(LANDMARKS, dtype=np.float32)
        buffers = (_floats(places), _indices(vertices), _floats(sure))
        error = c_void_p()
        self._check(self._library.anyface_landmarks_copy(handle, *buffers, byref(error)), error)
        roles = np.empty(self._library.anyface_landmarks_part_count(handle), dtype=np.int32)
        owners = np.empty(vertex_count, dtype=np.uint32)
        buffers = (roles.ctypes.data_as(POINTER(c_int32)), _indices(owners))
        self._check(
            self._library.anyface_landmarks_copy_parts(handle, *buffers, byref(error)), error
        )
        mouth = MOUTHS[self._library.anyface_landmarks_mouth(handle)]
        return Found(places, vertices, sure, mouth, roles, owners)

    def _mesh(self, handles, positions, triangles):
        positions = np.ascontiguousarray(positions, dtype=np.float32)
        triangles = np.ascontiguousarray(triangles, dtype=np.uint32)
        arrays = (_floats(positions), len(positions), _indices(triangles), len(triangles))
        return self._own(handles, "mesh", "anyface_mesh_new", *arrays)

    def _face_options(self, landmarks, vertices, roles, fixed=None):
        """The options, and the arrays that must live as long as they are used."""
        options = self._options(FaceOptions, "anyface_face_options_init")
        options.forward, options.up = _NEG_Y, _POS_Z
        arrays = {}
        if landmarks is not None:
            arrays["landmark_positions"] = np.asarray(landmarks, dtype=np.float32)
        elif vertices is not None:
            arrays["landmark_vertices"] = np.asarray(vertices, dtype=np.uint32)
        if fixed:
            options.fixed_count = len(fixed)
            arrays["fixed_numbers"] = np.array(list(fixed), dtype=np.uint32)
            arrays["fixed_positions"] = np.array(list(fixed.values()), dtype=np.float32)
        if roles is not None:
            options.part_count = len(roles.numbers)
            arrays["part_numbers"] = np.array(roles.numbers, dtype=np.uint32)
            arrays["part_roles"] = np.array(roles.number_roles, dtype=np.int32)
            options.object_vertex_count = len(roles.object_of_vertex)
            options.object_count = len(roles.object_roles)
            arrays["object_of_vertex"] = np.asarray(roles.object_of_vertex, dtype=np.uint32)
            arrays["object_roles"] = np.array(roles.object_roles, dtype=np.int32)
        kinds = dict(FaceOptions._fields_)
        for name, array in arrays.items():
            arrays[name] = np.ascontiguousarray(array)
            setattr(options, name, arrays[name].ctypes.data_as(kinds[name]))
        return options, arrays

    def _face(self, handles, positions, triangles, landmarks, vertices, performance, watch):
        mesh = self._mesh(handles, positions, triangles)
        options, _alive = self._face_options(landmarks, vertices, performance.roles)
        options.learned = performance.learned
        given = (self._handle, mesh, byref(options), watch.handle)
        return self._own(handles, "face", "anyface_face_new", *given)

    def _performed(self, handles, sound, performance, watch):
        """The motion, with controls that change over time put on frame by frame."""
        motion = self._motion(handles, sound, performance, watch)
        if not performance.control_keys:
            return motion

        def sample(controls) -> np.ndarray:
            asked = replace(performance, controls=controls)
            with ExitStack() as own:
                return self._displacements(self._motion(own, sound, asked, watch))

        base = self._displacements(motion)
        keys = performance.control_keys
        moved = sweep.over_time(base, performance.fps, performance.controls, keys, sample)
        moved = np.ascontiguousarray(moved, dtype=np.float32)
        given = (_floats(moved), len(moved), performance.fps)
        return self._own(handles, "motion", "anyface_motion_new_displacements", *given)

    def _displacements(self, motion) -> np.ndarray:
        """Landmark displacements `[T, 68, 3]` in metres."""
        frames = self._library.anyface_motion_frame_count(motion)
        moved = np.empty((frames, LANDMARKS, 3), dtype=np.float32)
        self._copy("anyface_motion_copy_displacements", motion, moved)
        return moved

    def _motion(self, handles, sound, performance, watch):
        samples = np.ascontiguousarray(sound.samples, dtype=np.float32)
        given = (_floats(samples), len(samples), 1, round(sound.rate_hz))
        audio = self._own(handles, "audio", "anyface_audio_new", *given)
        options = self._options(MotionOptions, "anyface_motion_options_init")
        options.emotion_source = EMOTION_SOURCES.index(performance.emotion_source)
        keys = performance.emotion if performance.emotion_source == "GIVEN" else []
        times = np.array([time for time, _ in keys], dtype=np.float64)
        rows = np.array([row for _, row in keys], dtype=np.float32)
        options.emotion_count = len(rows)
        if len(rows):
            options.emotion_strengths = _floats(rows)
            options.emotion_times_s = times.ctypes.data_as(POINTER(c_double))
        options.fps, options.seed = performance.fps, performance.seed
        options.style = performance.style.encode() or None
        options.steps = performance.steps or 0
        for name, value in asdict(performance.controls).items():
            setattr(options, name, value)
        given = (self._handle, audio, byref(options), watch.handle)
        return self._own(handles, "motion", "anyface_motion_new", *given)

    def _basis(self, handles, made, shape, limit: float, watch) -> Basis:
        """A face, its motion and its clip as a basis with sliders.

        `limit` and the basis' error are in mesh units here.
        """
        frames, vertices, _ = shape
        given = (made[-1], limit, MAX_VECTORS, watch.handle)
        basis = self._own(handles, "basis", "anyface_basis_new", *given)
        count = self._library.anyface_basis_shape_count(basis)
        vectors = np.empty((count, vertices, 3), dtype=np.float32)
        weights = np.empty((frames, count), dtype=np.float32)
        self._copy("anyface_basis_copy_shapes", basis, vectors)
        self._copy("anyface_basis_copy_weights", basis, weights)
        error = self._library.anyface_basis_max_error(basis)
        sliders = self._sliders(handles, *made, basis, weights.shape, watch)
        return Basis(vectors, weights, error, sliders)

    def _metres_per_unit(self, motion, clip) -> float:
        """The scale of the mesh, from the same motion in canonical metres and in its units."""
        metres = self._displacements(motion)
        units = np.empty_like(metres)
        self._copy("anyface_clip_copy_landmark_displacements", clip, units)
        length = float(np.linalg.norm(units))
        return float(np.linalg.norm(metres)) / length if length > 0.0 else 1.0

    def _options(self, kind, init: str):
        options = kind()
        self._check(getattr(self._library, init)(byref(options), ctypes.sizeof(kind)), None)
        return options

    def _own(self, handles: ExitStack, noun: str, function: str, *arguments):
        handle = self._make(function, *arguments)
        handles.callback(getattr(self._library, f"anyface_{noun}_free"), handle)
        return handle

    def _make(self, function: str, *arguments) -> c_void_p:
        out, error = c_void_p(), c_void_p()
        status = getattr(self._library, function)(*arguments, byref(out), byref(error))
        self._check(status, error)
        return out

    def _copy(self, function: str, handle, array: np.ndarray) -> None:
        error = c_void_p()
        call = getattr(self._library, function)
        self._check(call(handle, _floats(array), array.size, byref(error)), error)

    def _call(self, function: str, *arguments) -> None:
        error = c_void_p()
        status = getattr(self._library, function)(*arguments, byref(error))
        self._check(status, error)

    def _watch(self, progress: Progress) -> "_Watch":
        return _Watch(self._library, progress)

    def _check(self, status: int, error: c_void_p | None) -> None:
        if status == 0:
            return
        message = f"the library returned status {status}"
        if error:
            message = self._library.anyface_error_message(error).decode()
            self._library.anyface_error_free(error)
        if status == _CANCELLED:
            raise Cancelled
        raise AnyfaceError(_KINDS.get(status, "internal"), message)


class _Watch:
    """Connects a Python `Progress` with the library's progress handle by polling.

    No Python runs in the library's threads; a cancel reaches them without waiting for one.
    """

    def __init__(self, library, progress: Progress):
        self._library, self._progress = library, progress
        self.handle = None

    def __enter__(self):
        self.handle = c_void_p(self._library.anyface_progress_new(None, None))
        self._progress.attach(self._read, self._cancel)
        return self

    def __exit__(self, *_):
        self._progress.detach()
        self._library.anyface_progress_free(self.handle)

    def _read(self) -> tuple[str, float]:
        stage, fraction = c_char_p(), c_float()
        self._library.anyface_progress_read(self.handle, byref(stage), byref(fraction))
        return (stage.value or b"").decode(), fraction.value

    def _cancel(self) -> None:
        self._library.anyface_progress_cancel(self.handle)


def _floats(array: np.ndarray):
    return array.ctypes.data_as(_FLOATS)


def _indices(array: np.ndarray):
    return array.ctypes.data_as(_INDICES)
