"""Opens and saves .blend files; a file is there whole or not at all."""

import glob
import os
import socket

import bpy

from ..core.errors import AnyfaceError


def open_file(path: str) -> None:
    """Opens a .blend; raises `AnyfaceError("file")`."""
    full = os.path.abspath(path)
    if not os.path.isfile(full):
        raise AnyfaceError("file", f"no file at {full}")
    try:
        bpy.ops.wm.open_mainfile(filepath=full, load_ui=False)
    except RuntimeError as error:
        raise AnyfaceError("file", f"{path}: {str(error).strip()}") from error


def save(path: str) -> str:
    """Writes the open file beside `path` and renames it; returns the whole path."""
    full = os.path.abspath(path)
    beside = _beside(full, f"{socket.gethostname()}-{os.getpid()}")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=beside, check_existing=False, copy=True)
        with open(beside, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(beside, full)
    except (RuntimeError, OSError) as error:
        raise AnyfaceError("file", f"{path}: {str(error).strip()}") from error
    return full


def remove_leftovers(path: str) -> None:
    """Takes away what processes that were killed while saving `path` have left."""
    folder, name = os.path.split(_beside(os.path.abspath(path), "*"))
    # Blender itself writes to a name with an @ at its end first.
    for found in glob.glob(os.path.join(glob.escape(folder), f"{name}*")):
        os.remove(found)


def _beside(full: str, mark: str) -> str:
    folder, name = os.path.split(full)
    return os.path.join(folder, f".{os.path.splitext(name)[0]}.anyface-{mark}.blend")
