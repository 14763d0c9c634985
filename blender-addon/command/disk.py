"""Opens and saves .blend files; either the whole file appears or none of it."""

import contextlib
import os

import bpy

from ..core import beside
from ..core.errors import AnyfaceError, readable


def open_file(path: str) -> None:
    """Opens a .blend; raises `AnyfaceError("file")`."""
    full = os.path.abspath(path)
    if not os.path.isfile(full):
        raise AnyfaceError("file", f"no file at {full}: check the path, or write that file first")
    try:
        bpy.ops.wm.open_mainfile(filepath=full, load_ui=False)
    except RuntimeError as error:
        # Blender's message begins with "Error: ".
        text = readable(error).removeprefix("Error: ").strip()
        remedy = "take a .blend that this Blender opens, or a backup of it"
        raise AnyfaceError("file", f"{path}: {text}: {remedy}") from error


def make_folder(path: str) -> None:
    """Makes a folder and its parents; raises `AnyfaceError("file")`."""
    try:
        os.makedirs(path, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        text = f"{path}: expected a folder to save in, got a file: choose another"
        raise AnyfaceError("file", text) from error


def save(path: str) -> str:
    """Saves the open file under a temporary name, renames it to `path`, returns the full path."""
    full = os.path.abspath(path)
    half = beside.name(full)
    try:
        bpy.ops.wm.save_as_mainfile(filepath=half, check_existing=False, copy=True)
        with open(half, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(half, full)
    except (RuntimeError, OSError) as error:
        text = readable(error).removeprefix("Error: ").strip()
        remedy = "see that the folder is there, may be written and has room"
        raise AnyfaceError("file", f"{path}: {text}: {remedy}") from error
    finally:
        # After success `half` has become `path`. Blender first writes to a name that ends in @.
        for left in (half, f"{half}@"):
            with contextlib.suppress(OSError):
                os.remove(left)
    return full
