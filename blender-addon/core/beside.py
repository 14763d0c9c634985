"""Temporary files beside a .blend while it is written, each process with its own name."""

import contextlib
import glob
import os
import socket


def name(path: str) -> str:
    """The temporary file that this process writes first and then renames to `path`."""
    return _name(os.path.abspath(path), f"{socket.gethostname()}-{os.getpid()}")


def remove_all(path: str) -> None:
    """Removes the temporary files of processes that were killed while they wrote `path`."""
    folder, start = os.path.split(_name(os.path.abspath(path), ""))
    start = start.removesuffix(".blend")
    # Blender itself first writes to a name with an @ at its end.
    for left_file in glob.glob(os.path.join(glob.escape(folder), f"{glob.escape(start)}*.blend*")):
        # A file that cannot be removed does no harm: the next try uses another name.
        with contextlib.suppress(OSError):
            os.remove(left_file)


def _name(full: str, mark: str) -> str:
    folder, file = os.path.split(full)
    return os.path.join(folder, f".{os.path.splitext(file)[0]}.anyface-{mark}.blend")
