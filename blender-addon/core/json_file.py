"""JSON files that are read with clear errors and never half written. No bpy."""

import json
import os
import socket
from pathlib import Path

from .errors import AnyfaceError


def read(path):
    """What the file holds. Raises `AnyfaceError`: "file" where it cannot be read, "input" where it
    is no JSON."""
    path = Path(path)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise AnyfaceError("input", f"{path}: not JSON: {error}") from error


def write(path, content) -> None:
    """Writes beside, then renames: a reader finds the old file or the whole new one.

    Raises `AnyfaceError("file")`; what lay there stays.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(beside, "w", encoding="utf-8") as file:
            file.write(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
