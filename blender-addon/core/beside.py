"""Files that stand beside a .blend while it is written, under names of their own."""

import contextlib
import glob
import os
import socket


def name(path: str) -> str:
    """Where this process writes what will become `path`."""
    return _name(os.path.abspath(path), f"{socket.gethostname()}-{os.getpid()}")


def remove_all(path: str) -> None:
    """Takes away what processes that were killed while they wrote `path` have left."""
    folder, start = os.path.split(_name(os.path.abspath(path), ""))
    start = start.removesuffix(".blend")
    # Blender itself writes to a name with an @ at its end first.
    for left_file in glob.glob(os.path.join(glob.escape(folder), f"{glob.escape(start)}*.blend*")):
        # What cannot go is in nobody's way: the next try has another name.
        with contextlib.suppress(OSError):
            os.remove(left_file)


def _name(full: str, mark: str) -> str:
    folder, file = os.path.split(full)
    return os.path.join(folder, f".{os.path.splitext(file)[0]}.anyface-{mark}.blend")
