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
)
from itertools import count, takewhile
from pathlib import Path

from .errors import AnyfaceError
from .signatures import ABI_VERSION, SIGNATURES


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
