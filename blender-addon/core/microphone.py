"""The microphone: a native library of its own, which is loaded only when it is needed."""

import ctypes
import sys
import threading
from ctypes import POINTER, byref, c_char_p, c_double, c_float, c_int32, c_size_t, c_void_p
from functools import cache
from pathlib import Path

import numpy as np

from .arrays import bytes_of
from .errors import AnyfaceError
from .library import library_path

RATE_HZ = 16000
# Room for messages and names, bytes.
_ROOM = 4096
# The most samples that are read at a time, four seconds.
_MOST = 4 * RATE_HZ
_SIGNATURES = {
    "anyface_microphone_open": (c_void_p, [c_char_p, c_char_p, c_size_t]),
    "anyface_microphone_name": (c_size_t, [c_void_p, c_char_p, c_size_t]),
    "anyface_microphone_read": (
        c_size_t,
        [c_void_p, POINTER(c_float), c_size_t, c_double, POINTER(c_int32)],
    ),
    "anyface_microphone_close": (None, [c_void_p]),
    "anyface_microphone_devices": (c_size_t, [c_char_p, c_size_t]),
}


def path() -> Path:
    """The path of the library, beside the main one."""
    names = {"win32": "anyface_microphone.dll", "darwin": "libanyface_microphone.dylib"}
    return library_path().with_name(names.get(sys.platform, "libanyface_microphone.so"))


def why_missing() -> str:
    """Why no microphone can be heard; "" if the library is there."""
    place = path()
    return "" if place.is_file() else f"expected {place.name} in {place.parent}"


@cache
def _library() -> ctypes.CDLL:
    if reason := why_missing():
        raise AnyfaceError("audio", f"microphone: {reason}")
    try:
        library = ctypes.CDLL(str(path()))
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        # On Linux libasound.so.2 may be missing.
        raise AnyfaceError(
            "audio", f"microphone: the system's sound library cannot be used: {error}"
        ) from error
    return library


def devices() -> list[str]:
    """Names of the devices that record, the system's choice first. Raises `AnyfaceError`."""
    library = _library()
    room = ctypes.create_string_buffer(library.anyface_microphone_devices(None, 0) + _ROOM)
    library.anyface_microphone_devices(room, len(room))
    return [name for name in room.value.decode("utf-8", "replace").split("\n") if name]


class Microphone:
    """A device that is being recorded: mono, 16 kHz. Threads may share it.

    `name` is a device's name or a part of it; if it is empty, the system chooses the device.
    Raises `AnyfaceError`.
    """

    def __init__(self, name: str = ""):
        self._library = _library()
        message = ctypes.create_string_buffer(_ROOM)
        device = bytes_of("microphone", name) or None
        self._handle = self._library.anyface_microphone_open(device, message, len(message))
        if not self._handle:
            raise AnyfaceError("audio", message.value.decode("utf-8", "replace"))
        # Whether the device is gone. It delivers silence then, and comes back by itself.
        self.is_lost = False
        self._room = np.empty(_MOST, np.float32)
        self._lock = threading.Lock()

    @property
    def name(self) -> str:
        """Name of the device."""
        room = ctypes.create_string_buffer(_ROOM)
        with self._lock:
            self._library.anyface_microphone_name(self._open(), room, len(room))
        return room.value.decode("utf-8", "replace")

    def read(self) -> np.ndarray:
        """Returns the samples `[S]` since the last call, -1 to 1, without waiting for more."""
        is_lost = c_int32()
        row = self._room.ctypes.data_as(POINTER(c_float))
        with self._lock:
            read = self._library.anyface_microphone_read
            count = read(self._open(), row, _MOST, 0, byref(is_lost))
            self.is_lost = bool(is_lost.value)
            return self._room[:count].copy()

    def close(self) -> None:
        """Ends recording."""
        with self._lock:
            handle, self._handle = self._handle, None
            if handle is not None:
                self._library.anyface_microphone_close(handle)

    def _open(self):
        if self._handle is None:
            raise AnyfaceError("input", "microphone: expected an open one, got a closed one")
        return self._handle

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
