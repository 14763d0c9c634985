"""The C interface of the native library: its structs, how to load it.

ctypes releases Python's lock during a call, so Blender's interface keeps running while a thread
waits here.
"""

import ctypes
import os
import sys
from collections.abc import Callable
from ctypes import (
    POINTER,
    Structure,
    c_char_p,
    c_double,
    c_float,
    c_int32,
    c_size_t,
    c_uint32,
    c_void_p,
)
from itertools import count, takewhile
from pathlib import Path

from .errors import AnyfaceError
from .signatures import ABI_VERSION, SIGNATURES


class EngineOptions(Structure):
    """`AnyfaceEngineOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("weights_dir", c_char_p),
        ("speech_dir", c_char_p),
        ("cache_dir", c_char_p),
        ("cache", c_int32),
        ("threads", c_uint32),
        ("system", c_char_p),
        ("emotion_model_dir", c_char_p),
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
        ("request", c_void_p),
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


class Event(Structure):
    """`AnyfaceEvent`."""

    _fields_ = [
        ("start_s", c_double),
        ("end_s", c_double),
        ("units", POINTER(c_char_p)),
        ("unit_count", c_size_t),
        ("strength", c_float),
        ("over_speech", c_int32),
    ]


def library_path() -> Path:
    """The library in `lib` beside this folder; `ANYFACE_LIBRARY` names another one."""
    variable = os.environ.get("ANYFACE_LIBRARY")
    names = {"win32": "anyface.dll", "darwin": "libanyface.dylib"}
    name = names.get(sys.platform, "libanyface.so")
    return Path(variable) if variable else Path(__file__).resolve().parents[1] / "lib" / name


def load(path: Path) -> ctypes.CDLL:
    """Loads the library and declares its functions; raises `AnyfaceError("weights")`."""
    try:
        library = ctypes.CDLL(str(path))
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise AnyfaceError("weights", f"the native library cannot be used: {error}") from error
    version = library.anyface_abi_version()
    if version != ABI_VERSION:
        raise AnyfaceError(
            "weights", f"{path}: expected interface {ABI_VERSION}, got {version}: install it again"
        )
    return library


def texts(function: Callable[[int], bytes | None]) -> list[str]:
    """The texts that a function of the library returns for 0, 1, 2, …, until it returns none."""
    entries = takewhile(lambda text: text is not None, map(function, count()))
    return [text.decode() for text in entries]
