"""An engine of the native library: meshes and sounds as numpy arrays in, motion out."""

import copy
import math
import weakref
from contextlib import ExitStack
from ctypes import POINTER, byref, c_char_p, c_double, c_float, c_int32, c_uint32, c_void_p
from pathlib import Path

import numpy as np

from . import sparse, systems
from .arrays import array_of, bytes_of, number_of, path_of
from .errors import AnyfaceError
from .heard_emotion import HeardEmotion
from .job import Progress
from .library import library_path, load
from .native_basis import BasisCalls
from .native_curves import CurveCalls
from .native_events import EventCalls
from .native_head import HeadCalls
from .native_live import LiveCalls
from .native_mesh import MeshCalls
from .native_opening import OpeningCalls
from .native_performers import PerformerCalls
from .native_shapes import Clip, ShapeCalls
from .native_sounds import SoundCalls
from .take import (
    LIDS,
    MOUTHS,
    VISIBILITIES,
    Animation,
    Found,
    Landmarks,
    Life,
    PartRoles,
    Request,
    Sound,
)

LANDMARKS = 68
AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
# Samples of a decoded sound are mono at this rate.
_DECODED_RATE_HZ = 16000.0
_FLOATS, _DOUBLES, _INDICES = POINTER(c_float), POINTER(c_double), POINTER(c_uint32)


class Engine(
    BasisCalls,
    CurveCalls,
    EventCalls,
    HeadCalls,
    LiveCalls,
    MeshCalls,
    OpeningCalls,
    PerformerCalls,
    ShapeCalls,
    SoundCalls,
):
    """Loaded models; any number of threads may use one engine.

    `forward` and `up` are the axes of the meshes that it is given: Blender's heads face -Y with +Z
    up.
    """

    forward, up = "-y", "+z"

    def __init__(
        self,
        threads: int = 0,
        cache: Path | None = None,
        system: str = "",
        weights: Path | None = None,
    ):
        """Loads the models of `system`; the default is the first system.

        `cache` is the folder for results that depend only on a mesh; without it the user's own
        cache folder is used. `weights` is a folder of model files that replace the built-in ones.
        Raises `AnyfaceError`.
        """
        self._library = load(library_path())
        self._models: _Models | None = None
        self.models = weights
        description = systems.find(system, systems.read(self._library))
        self._description, self._sliders_offered = description, description.sliders
        folders = {"cache": cache, "weights_dir": weights}
        with ExitStack() as handles:
            request = self._own(handles, "request", "anyface_request_new")
            count = number_of("threads", threads)
            self._call("anyface_request_set_number", request, b"threads", count)
            for name, text in {"system": system, **folders}.items():
                self._text(request, name, "" if text is None else text)
            handle = self._make("anyface_engine_new", request)
        self._models = _Models(handle.value)
        free = self._library.anyface_engine_free
        # The operating system frees them sooner where the program ends.
        weakref.finalize(self._models, free, handle).atexit = False

    @property
    def fields(self) -> tuple[systems.Field, ...]:
        """What else a performance can be asked for."""
        return self._description.fields

    @property
    def controls(self) -> tuple[systems.Control, ...]:
        """The controls that the system offers."""
        return self._description.controls

    def facing(self, forward: str, up: str) -> "Engine":
        """An engine with the same models for meshes with other axes.

        Raises `AnyfaceError("input")` for a word that is not in `AXES`.
        """
        for name, axis in (("forward", forward), ("up", up)):
            if not isinstance(axis, str) or axis not in AXES:
                known = ", ".join(AXES)
                raise AnyfaceError("input", f"{name}: expected one of {known}, got {axis!r}")
        other = copy.copy(self)
        other.forward, other.up = forward, up
        return other

    def close(self) -> None:
        """Frees the models, once running calls and engines for other axes no longer use them."""
        self._models = None

    @property
    def _handle(self) -> "_Models":
        """The models for a call, which stay until it ends. Raises `AnyfaceError("input")`."""
        if self._models is None:
            raise AnyfaceError("input", "engine: expected an open one, got a closed one")
        return self._models

    def emotions(self) -> list[str]:
        """The names of the emotions, in the order of their strengths."""
        return list(self._description.emotions)

    def decode(self, path: str) -> tuple[np.ndarray, float, str]:
        """Mono samples `[S]` float32 of a sound file, their rate in Hz, and a warning.

        The warning says which part of the sound is missing because the file is damaged, "" for
        none. Raises `AnyfaceError`, with "audio" also if more than a fifth is missing.
        """
        with ExitStack() as handles:
            audio = self._own(handles, "audio", "anyface_audio_read", path_of(path))
            count = self._library.anyface_audio_sample_count(audio)
            samples = np.empty(count, dtype=np.float32)
            self._copy("anyface_audio_copy_samples", audio, samples)
            warning = self._library.anyface_audio_warning(audio) or b""
            return samples, _DECODED_RATE_HZ, warning.decode()

    def is_damaged(self, path: str) -> bool:
        """Whether `decode` refuses a sound file only because too much of it is missing."""
        with ExitStack() as handles:
            name = "anyface_audio_read_damaged"
            try:
                self._own(handles, "audio", name, path_of(path))
            except AnyfaceError:
                return False
        return True

    def animate(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        request: Request,
        progress: Progress,
    ) -> Animation:
        """Animates one mesh that has the axes of this engine, in any units.

        `positions` `[V, 3]` float32, `triangles` `[F, 3]` uint32, `landmarks` `[68, 3]`,
        `landmark_vertices` `[68]`, both or neither. Raises `AnyfaceError`, or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(_Watch(self._library, progress))
            marks = landmarks, landmark_vertices
            notes = self._memory_notes(len(positions), sound, request)
            face = self._face(handles, positions, triangles, marks, request, watch)
            motion, clip = self._spoken(handles, face, sound, request, watch)
            results = face, motion, clip
            animation = self._animation(handles, results, request, watch)
            animation.notes = notes + animation.notes
            return animation

    def _memory_notes(self, vertices: int, sound: Sound, request: Request) -> list[str]:
        """A note if a take may not fit into memory, which holds every frame twice; else empty."""
        sound_s = len(sound.samples) / sound.rate_hz
        frames = 2 * math.ceil(request.fps * sound_s)
        left = self._library.anyface_memory_left()
        needed = self._library.anyface_engine_memory_needed(self._handle, vertices, frames, sound_s)
        if needed <= left:
            return []
        needed, left = needed >> 20, left >> 20
        return [f"takes about {needed} MB of memory, and {left} MB were left"]

    def _spoken(self, handles, face, sound, request, watch):
        motion = self._motion(handles, sound, request, watch, face)
        arguments = (self._handle, face, motion, watch.handle)
        clip = Clip(self, self._make("anyface_clip_new", *arguments))
        if not request.keeps_clip:
            handles.callback(clip.close)
        return motion, clip

    def _face(self, handles, positions, triangles, landmarks, request, watch):
        """A mesh prepared for animation; `landmarks` are positions and vertex numbers."""
        mesh = self._mesh(handles, positions, triangles)
        handle = self._controls(handles, request, systems.FACE)
        self._ask_face(handle, *landmarks, request.roles)
        arguments = (self._handle, mesh, handle, watch.handle)
        return self._own(handles, "face", "anyface_face_new", *arguments)

    def _animation(self, handles, results, request, watch) -> Animation:
        """A face, its motion and its clip as numpy arrays."""
        face, _, clip = results
        mm_per_unit = 1000.0 * self._library.anyface_face_metres_per_unit(face)
        largest = self._library.anyface_clip_largest_displacement(clip)
        visibility = VISIBILITIES[self._library.anyface_clip_visibility(clip)]
        animation = Animation(largest * mm_per_unit, visibility)
        animation.mouth, animation.lids = self._mouth(face), self._lids(face)
        animation.life = self._life(results, clip.shape[0])
        animation.landmarks = self._landmarks(clip, clip.shape[0])
        animation.unit_mm = mm_per_unit
        animation.touching = sparse.touching(animation.landmarks, mm_per_unit)
        animation.shape_weights = self._shape_weights(results[1])
        animation.heard_emotion = HeardEmotion.of_json(
            self._library.anyface_motion_heard_emotion(results[1])
        )
        animation.notes = self._unseen(face, results[1], request.events, watch)
        if request.keeps_clip:
            animation.clip = clip
            return animation
        if request.error_mm is None:
            animation.displacements = clip.displacements()
            return animation
        limit = request.error_mm / mm_per_unit
        if request.layered:
            animation.basis = self._layers(handles, results, limit, watch)
        else:
            animation.basis = self._basis(handles, results, limit, watch)
        animation.basis.error_mm *= mm_per_unit
        return animation

    def _life(self, spoken, frames: int) -> Life:
        face, motion, _ = spoken
        head = np.empty((frames, 3), dtype=np.float32)
        gaze = np.empty((frames, 2, 2), dtype=np.float32)
        tongue = np.empty((frames, 4), dtype=np.float32)
        way = np.empty((3, 4), dtype=np.float32)
        self._copy("anyface_motion_copy_head", motion, head)
        self._copy("anyface_motion_copy_gaze", motion, gaze)
        self._copy("anyface_motion_copy_tongue", motion, tongue)
        self._copy("anyface_face_copy_to_canonical", face, way)
        return Life(head, gaze, way, tongue=tongue)

    def _landmarks(self, clip, frames: int) -> Landmarks:
        neutral = np.empty((LANDMARKS, 3), dtype=np.float32)
        moved = np.empty((frames, LANDMARKS, 3), dtype=np.float32)
        self._copy("anyface_clip_copy_landmarks_neutral", clip, neutral)
        self._copy("anyface_clip_copy_landmark_displacements", clip, moved)
        return Landmarks(neutral, moved)

    def mask(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        request: Request,
        frame: int,
        progress: Progress,
    ) -> np.ndarray:
        """How far each vertex shows emotion rather than speech in one frame: `[V]`, 0 to 1.

        A frame outside the take counts as its nearest one. The other arguments are those of
        `animate`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(_Watch(self._library, progress))
            marks = landmarks, landmark_vertices
            face = self._face(handles, positions, triangles, marks, request, watch)
            motion = self._motion(handles, sound, request, watch, face)
            last = self._library.anyface_motion_frame_count(motion) - 1
            out = np.empty(len(positions), dtype=np.float32)
            arguments = (
                motion,
                self._handle,
                face,
                min(max(frame, 0), last),
                _floats(out),
                out.size,
            )
            self._call("anyface_motion_copy_mask", *arguments)
            return out

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
        """The landmarks of a mesh with the axes of this engine, how its lips meet, and its parts.

        `fixed` maps numbers of landmarks to positions `[3]` at which they stay; the other landmarks
        follow. The other arguments are those of `animate`. Raises `AnyfaceError`, or `Cancelled`.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(_Watch(self._library, progress))
            marks = landmarks, landmark_vertices
            face = self._found_face(handles, positions, triangles, marks, watch, roles, fixed)
            return self._found(face, len(positions))

    def _found_face(self, handles, positions, triangles, landmarks, watch, roles=None, fixed=None):
        """A mesh with its face found; `landmarks` are positions and vertex numbers."""
        mesh = self._mesh(handles, positions, triangles)
        request = self._face_request(handles, *landmarks, roles, fixed)
        arguments = (self._handle, mesh, request, watch.handle)
        return self._own(handles, "face", "anyface_face_find", *arguments)

    def _found(self, face, vertex_count: int) -> Found:
        places = np.empty((LANDMARKS, 3), dtype=np.float32)
        vertices = np.empty(LANDMARKS, dtype=np.uint32)
        sure = np.empty(LANDMARKS, dtype=np.float32)
        buffers = (_floats(places), _indices(vertices), _floats(sure))
        self._call("anyface_face_copy_landmarks", face, *buffers)
        roles = np.empty(self._library.anyface_face_part_count(face), dtype=np.int32)
        owners = np.empty(vertex_count, dtype=np.uint32)
        parts = (roles.ctypes.data_as(POINTER(c_int32)), _indices(owners))
        self._call("anyface_face_copy_parts", face, *parts)
        return Found(places, vertices, sure, self._mouth(face), roles, owners, self._lids(face))

    def _mouth(self, face) -> str:
        return MOUTHS[self._library.anyface_face_mouth(face)]

    def _lids(self, face) -> tuple[str, str]:
        right, left = (LIDS[self._library.anyface_face_lids(face, side)] for side in (0, 1))
        return right, left

    def _face_request(self, handles, landmarks, vertices, roles, fixed=None):
        """A request of the library with what is known about a face."""
        request = self._own(handles, "request", "anyface_request_new")
        self._ask_face(request, landmarks, vertices, roles, fixed)
        return request

    def _ask_face(self, request, landmarks, vertices, roles, fixed=None) -> None:
        """Puts what is known about a face into a request of the library."""
        self._text(request, "forward", self.forward)
        self._text(request, "up", self.up)
        rows = {"landmarks": landmarks, "landmark_vertices": vertices}
        if fixed:
            rows["fixed_landmarks"] = [(number, *place) for number, place in fixed.items()]
        if roles is not None:
            rows["part_roles"] = np.column_stack([roles.numbers, roles.number_roles])
            # The number of no object, 2^32 - 1, becomes -1.
            owners = array_of("object_of_vertex", roles.object_of_vertex, np.uint32, "V")
            rows["object_of_vertex"] = owners.view(np.int32)
            rows["object_roles"] = roles.object_roles
        for name, values in rows.items():
            if values is not None:
                self._rows(request, name.encode(), None, values)

    def _text(self, request, name: str, text) -> None:
        """Asks for a text or a path; an empty one asks for nothing."""
        self._call("anyface_request_set_text", request, name.encode(), path_of(text))

    def _controls(self, handles, request: Request, stage: str):
        """A request of the library with the controls of a stage."""
        new = self._own(handles, "request", "anyface_request_new")
        for control in self._description.controls:
            if control.stage != stage:
                continue
            name = control.name.encode()
            value = request.controls.get(control.name, control.default)
            self._call("anyface_request_set_number", new, name, value)
            if control.name in request.control_keys:
                self._rows(new, name, *request.control_keys[control.name])
        return new

    def _rows(self, handle, name: bytes, times, rows) -> None:
        """Asks for rows of numbers, at `times` in seconds or at none."""
        what, axes = name.decode(), ("N", "C")[: 1 if np.ndim(rows) == 1 else 2]
        rows = array_of(what, rows, np.float64, *axes)
        columns = 1 if rows.ndim == 1 else rows.shape[1]
        if times is not None:
            times = array_of(f"seconds of {what}", times, np.float64, len(rows))
        at = None if times is None else _doubles(times)
        function = "anyface_request_set_rows"
        self._call(function, handle, name, at, _doubles(rows), len(rows), columns)

    def _ask(self, handles, handle, kind: str, name: bytes, value, face) -> None:
        """Asks for the value of a field, of which the library says its kind."""
        if isinstance(value, str):
            self._call("anyface_request_set_text", handle, name, bytes_of(name.decode(), value))
        elif kind == "number":
            self._call("anyface_request_set_number", handle, name, value)
        elif kind == "sound":
            sound = self._audio(handles, value)
            self._call("anyface_request_set_sound", handle, name, sound)
        elif kind == "intervals":
            self._rows(handle, name, None, np.reshape(value, (-1, 2)))
        elif kind == "emotion" and len(value):
            times, rows = zip(*value, strict=True)
            self._rows(handle, name, times, np.array(rows, dtype=np.float32))
        elif kind == "pose" and face is not None:
            pose = self._pose(handles, face, value)
            self._call("anyface_request_set_motion", handle, name, pose)

    def _audio(self, handles, sound):
        samples = array_of("samples", sound.samples, np.float32, "S")
        arguments = (_floats(samples), len(samples), 1, round(sound.rate_hz))
        return self._own(handles, "audio", "anyface_audio_new", *arguments)

    def _pose(self, handles, face, displacements):
        """The pose of a face whose vertices are displaced, as a motion of one frame."""
        moved = array_of("pose", displacements, np.float32, "V", 3)
        arguments = (face, _floats(moved), len(moved))
        return self._own(handles, "motion", "anyface_motion_new_pose", *arguments)

    def _motion(self, handles, sound, request, watch, face=None):
        audio = self._audio(handles, sound)
        handle = self._controls(handles, request, systems.MOTION)
        self._call("anyface_request_set_number", handle, b"fps", request.fps)
        if request.events:
            events = self._events_json(request.events).encode()
            self._call("anyface_request_set_text", handle, b"events", events)
        for known in self._description.fields:
            value = request.fields.get(known.name)
            if value is not None:
                self._ask(handles, handle, known.kind, known.name.encode(), value, face)
        arguments = (self._handle, audio, handle, watch.handle)
        return self._own(handles, "motion", "anyface_motion_new", *arguments)

    def _watch(self, progress: Progress) -> "_Watch":
        return _Watch(self._library, progress)


class _Models(c_void_p):
    """The library's engine. It is freed with the last reference to this object."""


class _Watch:
    """Connects a Python `Progress` with the library's progress handle by polling.

    The library's threads run no Python, and a cancel need not wait for a call back into Python.
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


def _doubles(array: np.ndarray):
    return array.ctypes.data_as(_DOUBLES)


def _indices(array: np.ndarray):
    return array.ctypes.data_as(_INDICES)
