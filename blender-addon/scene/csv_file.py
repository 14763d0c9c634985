"""A take as a table of ARKit weights; the mesh stays as it is."""

import hashlib
import json
from pathlib import Path

import bpy

from ..core.errors import AnyfaceError

PROPERTY = "anyface_csv"


def path_of(ob, given: str) -> Path:
    """Where the table goes; by default beside the .blend, named after the object."""
    return Path(bpy.path.abspath(given or f"//{bpy.path.clean_name(ob.name)}.csv"))


def check(ob, path: Path) -> None:
    """Raises `AnyfaceError("file")` where a file would be overwritten that is not ours."""
    if path.suffix.lower() != ".csv":
        raise AnyfaceError("file", f"{path}: expected a name that ends in .csv")
    if path.exists() and not _is_ours(ob, path):
        raise AnyfaceError("file", f"{path} exists already: choose another name or delete it")


def write_record(ob, path: Path) -> None:
    """Remembers the file, so that Remove knows it; a linked object cannot."""
    if ob.library is None:
        ob[PROPERTY] = json.dumps({"path": str(path), "digest": _digest(path)})


def find(ob) -> Path | None:
    """The table that was written for `ob`, or None."""
    try:
        return Path(json.loads(ob[PROPERTY])["path"])
    except (KeyError, ValueError, TypeError):
        return None


def remove(ob) -> bool:
    """Deletes the table, unless somebody has changed it; False where there is none."""
    path = find(ob)
    if path is None or ob.library is not None:
        return False
    if _is_ours(ob, path):
        path.unlink()
    del ob[PROPERTY]
    return True


def _is_ours(ob, path: Path) -> bool:
    if find(ob) != path or not path.is_file():
        return False
    return json.loads(ob[PROPERTY])["digest"] == _digest(path)


def _digest(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=12).hexdigest()
