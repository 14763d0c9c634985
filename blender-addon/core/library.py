"""Where the native library is, and how to load it.

ctypes releases Python's lock during a call, so Blender's interface keeps running while a thread
waits here.
"""

import ctypes
import os
import sys
from pathlib import Path

from .errors import AnyfaceError
from .signatures import ABI_VERSION, SIGNATURES


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
