"""Faces that follow a voice: a loaded sound, at any time in any order, or a microphone."""

import math
from contextlib import ExitStack
from ctypes import POINTER, byref, c_float, c_size_t, c_void_p

import numpy as np

from .arrays import array_of
from .calls import Calls
from .emotion import EMOTIONS
from .errors import AnyfaceError
from .job import Progress
from .microphone import Microphone
from .take import Request, Sound

_LANDMARKS = 68
FPS = 25.0
_RATE_HZ = 16000
_SAMPLES = round(_RATE_HZ / FPS)
# After a jump the stream starts this many frames early, so that the face is already in motion.
_WARM_FRAMES = 50
# The stream plays through jumps of up to this many frames. After a longer jump it starts anew.
_MAX_AHEAD = 100
_FLOATS = POINTER(c_float)


class LiveCalls(Calls):
    """The calls of `native.Engine` for faces that follow a voice."""

    def live(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        sound: Sound,
        request: Request,
        progress: Progress,
    ) -> "LiveFace":
        """A mesh prepared to follow `sound`; the arguments are those of `animate`.

        Raises `AnyfaceError`: "input" for a system that needs the whole sound.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            with ExitStack() as stack:
                marks = landmarks, landmark_vertices
                face = self._face(stack, positions, triangles, marks, request, watch)
                audio = self._audio(stack, sound)
                samples = np.empty(self._library.anyface_audio_sample_count(audio), np.float32)
                self._copy("anyface_audio_copy_samples", audio, samples)
                follower = LiveFace(self, face, len(positions), samples)
                follower.start(0)
                follower.keep(stack.pop_all())
                return follower

    def live_microphone(
        self,
        positions: np.ndarray,
        triangles: np.ndarray,
        landmarks: np.ndarray | None,
        landmark_vertices: np.ndarray | None,
        microphone: str,
        look_ahead: float,
        request: Request,
        progress: Progress,
    ) -> "ListeningFace":
        """A mesh prepared to follow a microphone, "" for the system's choice.

        `look_ahead`: the most seconds of later sound that a frame waits for, if the system can work
        with so little.

        Raises `AnyfaceError`: "audio" if the microphone cannot be recorded.
        """
        with ExitStack() as handles:
            watch = handles.enter_context(self._watch(progress))
            with ExitStack() as stack:
                marks = landmarks, landmark_vertices
                face = self._face(stack, positions, triangles, marks, request, watch)
                device = stack.enter_context(Microphone(microphone))
                follower = ListeningFace(self, face, len(positions), device, look_ahead)
                follower.keep(stack.pop_all())
                return follower


class StreamedFace:
    """A face and a stream that moves it. Belongs to one thread; `close` it."""

    # Whether it follows a microphone instead of the scene's frame.
    listens = False

    def __init__(self, engine, face, vertices: int):
        self._engine, self._face, self._vertices = engine, face, vertices
        self._handles, self._streams = ExitStack(), ExitStack()
        # What the stream is asked for beside its emotion.
        self._numbers: dict[bytes, float] = {}
        self._strengths: np.ndarray | None = None
        self._feels_anew = False

    def keep(self, handles: ExitStack) -> None:
        """Takes over handles that are freed together with this face."""
        self._handles = handles

    def close(self) -> None:
        """Frees the stream and the face."""
        self._streams.close()
        self._handles.close()

    def feel(self, strengths) -> None:
        """Sets the emotion from the next requested frame on: `[15]` strengths.

        Raises `AnyfaceError`.
        """
        row = array_of("emotion", strengths, np.float32, len(EMOTIONS))
        if self._strengths is None or not np.array_equal(row, self._strengths):
            self._strengths, self._feels_anew = row, True
            self._obey()

    def _open_stream(self) -> None:
        """Replaces the stream with a new one that starts from rest."""
        self._streams.close()
        engine = self._engine
        self._stream = engine._own(self._streams, "stream", "anyface_stream_new", engine._handle)
        self._obey()

    def _obey(self) -> None:
        """Asks the stream for the emotion and the numbers of this face."""
        engine = self._engine
        with ExitStack() as handles:
            request = engine._own(handles, "request", "anyface_request_new")
            if self._strengths is not None:
                engine._rows(request, b"emotion", None, self._strengths[np.newaxis])
            for name, number in self._numbers.items():
                engine._call("anyface_request_set_number", request, name, number)
            engine._call("anyface_stream_obey", self._stream, request)

    def _push_samples(self, samples: np.ndarray) -> None:
        if len(samples):
            row = samples.ctypes.data_as(_FLOATS)
            self._engine._call("anyface_stream_push", self._stream, row, len(samples))

    def _next_row(self) -> np.ndarray | None:
        """Displacements `[68, 3]` of the next frame, or None if it needs more samples."""
        row, count = np.empty((1, _LANDMARKS, 3), dtype=np.float32), c_size_t()
        place = row.ctypes.data_as(_FLOATS)
        self._engine._call("anyface_stream_pull", self._stream, place, 1, byref(count))
        return row[0] if count.value else None

    def _moved(self, landmarks: np.ndarray) -> np.ndarray:
        """The mesh `[V, 3]` under displacements of the landmarks `[68, 3]`."""
        engine = self._engine
        with ExitStack() as handles:
            row = array_of("landmarks", landmarks, np.float32, _LANDMARKS, 3)
            frame = (row.ctypes.data_as(_FLOATS), 1, FPS)
            motion = engine._own(handles, "motion", "anyface_motion_new_displacements", *frame)
            parts = (engine._handle, self._face, motion, c_void_p())
            clip = engine._own(handles, "clip", "anyface_clip_new", *parts)
            lent = engine._library.anyface_clip_displacements(clip)
            return np.ctypeslib.as_array(lent, (self._vertices, 3)).copy()


class ListeningFace(StreamedFace):
    """A face that follows a microphone, `delay_s` behind."""

    listens = True

    def __init__(self, engine, face, vertices: int, microphone: Microphone, look_ahead: float):
        super().__init__(engine, face, vertices)
        self._microphone = microphone
        self._displacements = np.zeros((vertices, 3), dtype=np.float32)
        # The samples since the recording began; None if nothing is being recorded.
        self._recorded: list[np.ndarray] | None = None
        self._recorded_from = 0
        self._open_stream()
        self._numbers = {b"look_ahead_s": look_ahead}
        try:
            self._obey()
        except AnyfaceError as error:
            # The system cannot look so little ahead: the stream keeps its default.
            if error.kind != "input":
                raise
            self._numbers = {}
        self.delay_s = engine._library.anyface_stream_latency_s(self._stream)

    @property
    def name(self) -> str:
        """Name of the microphone."""
        return self._microphone.name

    @property
    def is_lost(self) -> bool:
        """Whether the microphone is gone for now."""
        return self._microphone.is_lost

    def at(self, _seconds: float = 0.0) -> np.ndarray:
        """Displacements `[V, 3]` of the mesh in the newest frame; the same array until the next
        frame is ready. Raises `AnyfaceError`."""
        samples = self._microphone.read()
        if self._recorded is not None:
            self._recorded.append(samples)
        self._push_samples(samples)
        newest = None
        while (row := self._next_row()) is not None:
            newest = row
        if newest is not None:
            self._displacements = self._moved(newest)
        return self._displacements

    @property
    def is_recording(self) -> bool:
        """Whether incoming sound is being recorded."""
        return self._recorded is not None

    def record(self, frame: int) -> None:
        """Records incoming sound from now on; the scene is at `frame`."""
        self._push_samples(self._microphone.read())
        self._recorded, self._recorded_from = [], frame

    def drop_recording(self) -> None:
        """Stops recording and discards the samples."""
        self._recorded = None

    def recording(self) -> tuple[Sound, int]:
        """The sound since `record` and the frame at which it began; the recording goes on."""
        samples = np.concatenate([np.zeros(0, np.float32), *(self._recorded or [])])
        return Sound(samples, float(_RATE_HZ), "recording"), self._recorded_from


class LiveFace(StreamedFace):
    """A face that follows a voice whose samples are all loaded."""

    def __init__(self, engine, face, vertices: int, samples: np.ndarray):
        super().__init__(engine, face, vertices)
        self._samples = samples
        # The next frame of the stream, its first frame, and the next sample to push.
        self._next = self._first = self._pushed = 0
        self._ended = False
        # The time that was last requested, in seconds of the voice.
        self._shown_s = -1.0
        self._rows = np.zeros((2, _LANDMARKS, 3), dtype=np.float32)

    def at(self, seconds: float) -> np.ndarray:
        """Displacements `[V, 3]` of the mesh, in its own units, `seconds` into the voice.

        The mesh is at rest before the voice begins and after it has ended. Raises `AnyfaceError`.
        """
        frame = math.floor(seconds * FPS)
        if frame < 0 or frame >= len(self._samples) / _SAMPLES:
            return np.zeros((self._vertices, 3), dtype=np.float32)
        # The last two rows are those of the frames `_next - 2` and `_next - 1`.
        is_behind = frame + 2 < self._next
        # The time has not changed but the emotion has: compute this frame again.
        if seconds == self._shown_s and self._feels_anew:
            is_behind = True
        self._shown_s, self._feels_anew = seconds, False
        if is_behind or frame + 2 > self._next + _MAX_AHEAD:
            self.start(max(frame - _WARM_FRAMES, 0))
        self._pull(frame + 2)
        share = np.float32(seconds * FPS - frame)
        row = (1 - share) * self._rows[0] + share * self._rows[1]
        return self._moved(row)

    def start(self, frame: int) -> None:
        """Starts the stream at the sound of `frame`, with the face at rest."""
        # An artist who picks a sound expects all of it to move the face, music and noise too.
        self._numbers = {b"hear_all": 1.0}
        self._open_stream()
        self._next = self._first = frame
        self._pushed = frame * _SAMPLES
        self._ended = False
        self._rows[:] = 0.0

    def _pull(self, end: int) -> None:
        """Feeds the stream until `_rows` holds the frames `end - 2` and `end - 1`."""
        late_s = self._engine._library.anyface_stream_latency_s(self._stream)
        while self._next < end:
            needed = (self._next + 1) * _SAMPLES + math.ceil(late_s * _RATE_HZ)
            self._push(min(needed, len(self._samples)))
            row = self._next_row()
            self._rows[0] = self._rows[1]
            if row is not None:
                self._rows[1] = row
                if self._next == self._first:
                    self._rows[0] = row
            self._next += 1

    def _push(self, end: int) -> None:
        part = np.ascontiguousarray(self._samples[self._pushed : end])
        if len(part):
            self._push_samples(part)
            self._pushed = end
        if self._pushed == len(self._samples) and not self._ended:
            self._engine._call("anyface_stream_finish", self._stream)
            self._ended = True
