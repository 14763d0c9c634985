"""Weights of shapes for live speech: samples go in, frames come out."""

import threading
from contextlib import ExitStack
from ctypes import POINTER, byref, c_float, c_int32
from dataclasses import dataclass

import numpy as np

from .arrays import array_of, number_of
from .emotion import EMOTIONS
from .errors import AnyfaceError

SHAPES, VISEMES, FPS = 52, 15, 25.0
_FLOATS = POINTER(c_float)


@dataclass(frozen=True)
class Frame:
    """A face at one instant."""

    # Number of the frame; its time in the sound is `index / 25` seconds.
    index: int
    # Weights of ARKit's shapes `[52]` and Oculus' visemes `[15]`, 0 to 1, as `names` orders them.
    shapes: np.ndarray
    visemes: np.ndarray
    # Rotation vector of the head `[3]`, radians: x to the subject's left, y up, z to the front.
    head: np.ndarray

    @property
    def time_s(self) -> float:
        """Its time in the sound, seconds."""
        return self.index / FPS


class WeightStream:
    """A performance in progress: `push` samples, `pull` frames.

    Threads may share it: a call waits until the calls of other threads have ended. The frames do
    not depend on how the sound is cut into pushes. Raises `AnyfaceError`, "input" for
    a system that needs the whole sound.
    """

    def __init__(self, engine):
        self._engine = engine
        self._lock = threading.RLock()
        self._handles = ExitStack()
        self._handle = engine._own(
            self._handles, "weight_stream", "anyface_weight_stream_new", engine._handle
        )
        self._request = engine._own(self._handles, "request", "anyface_request_new")
        self._index = 0

    @property
    def latency_s(self) -> float:
        """A frame can be computed once this many seconds of sound after it are there."""
        with self._lock:
            return self._engine._library.anyface_weight_stream_latency_s(self._open())

    @property
    def names(self) -> tuple[list[str], list[str]]:
        """Names of the shapes and of the visemes."""
        name = self._engine._library.anyface_weight_stream_name
        names = [name(number).decode() for number in range(SHAPES + VISEMES)]
        return names[:SHAPES], names[SHAPES:]

    def push(self, samples) -> None:
        """Takes samples `[S]`, mono, 16 kHz, -1 to 1; any number."""
        block = array_of("samples", samples, np.float32).reshape(-1)
        self._call("push", block.ctypes.data_as(_FLOATS), len(block))

    def pull(self) -> Frame | None:
        """The next frame, or None if it needs more samples or the sound has ended."""
        shapes, visemes, head = (np.empty(n, np.float32) for n in (SHAPES, VISEMES, 3))
        is_ready = c_int32()
        rows = [row.ctypes.data_as(_FLOATS) for row in (shapes, visemes, head)]
        with self._lock:
            self._call("pull", *rows, byref(is_ready))
            index = self._index
            self._index += is_ready.value
        return Frame(index, shapes, visemes, head) if is_ready.value else None

    def frames(self):
        """All frames that are ready, one after another."""
        while (frame := self.pull()) is not None:
            yield frame

    def finish(self) -> None:
        """Ends the sound: every frame that has begun can now be pulled."""
        self._call("finish")

    def set_emotion(self, strengths) -> None:
        """Sets the emotion from the next frame on: `[15]` strengths in the order of `EMOTIONS`."""
        row = array_of("emotion", strengths, np.float32, len(EMOTIONS))
        with self._lock:
            self._open()
            self._engine._rows(self._request, b"emotion", None, row[np.newaxis])
            self._call("obey", self._request)

    def hear_emotion(self) -> None:
        """From now on shows the emotion heard in the voice, until `set_emotion` sets one."""
        with self._lock:
            self._open()
            self._engine._text(self._request, "emotion", "auto")
            self._call("obey", self._request)

    def set_performer(self, path, strength: float = 1.0) -> None:
        """Shows the performer of a file from the next frame on, as strongly as `strength`, 0 to 2.

        The performer was learned with FreeTalk; None shows none.
        """
        number = number_of("performer_strength", strength)
        with self._lock:
            self._open()
            self._engine._text(self._request, "performer", "" if path is None else path)
            name = b"performer_strength"
            self._engine._call("anyface_request_set_number", self._request, name, number)
            self._call("obey", self._request)

    def look_ahead(self, seconds: float) -> None:
        """Limits the look-ahead to `seconds`. Call it before the first sound."""
        self._obey_number(b"look_ahead_s", seconds)

    def hear_all(self) -> None:
        """From now on every sound moves the face: music and noise as well as speech."""
        self._obey_number(b"hear_all", 1.0)

    def close(self) -> None:
        """Frees the stream."""
        with self._lock:
            self._handle = None
            self._handles.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _obey_number(self, name: bytes, number: float) -> None:
        number = number_of(name.decode(), number)
        with self._lock:
            self._open()
            self._engine._call("anyface_request_set_number", self._request, name, number)
            self._call("obey", self._request)

    def _call(self, verb: str, *arguments) -> None:
        with self._lock:
            self._engine._call(f"anyface_weight_stream_{verb}", self._open(), *arguments)

    def _open(self):
        if self._handle is None:
            raise AnyfaceError("input", "stream: expected an open stream, got a closed one")
        return self._handle
