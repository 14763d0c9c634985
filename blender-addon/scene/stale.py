"""Finds point caches that do not fit the mesh that they move.

When a library changes, the mesh of a linked character changes, but the cache beside the shot stays.
The first frame of a cache is the mesh at rest, so it can be compared with the present mesh.
"""

import sys
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..core import pc2
from ..core.errors import AnyfaceError, say
from . import outputs
from .face.mesh import read_basis

# The tolerance for float32 rounding, as a share of the mesh's size.
_SAME = 1e-5
# This many vertices are enough to see whether a mesh has changed since it was last compared.
_FEW = 16
_known: dict[tuple, str] = {}


def of(ob) -> str:
    """Why the cache of `ob` does not fit its mesh; empty if it fits or there is no cache."""
    modifier = outputs.of("cache").find(ob) if ob is not None else None
    if modifier is None:
        return ""
    path = Path(bpy.path.abspath(modifier.filepath, library=modifier.id_data.library))
    try:
        state = path.stat()
    except OSError:
        return f"{ob.name}: no cache at {path}: find it, or generate again"
    key = str(path), state.st_size, state.st_mtime_ns, ob.name_full, *_look_of(ob.data)
    if key not in _known:
        _known[key] = _why(ob, path)
    return _known[key]


def everywhere() -> list[str]:
    """The messages of `of` for all objects of the file."""
    return [text for text in map(of, bpy.data.objects) if text]


def _look_of(mesh) -> tuple:
    step = max(1, len(mesh.vertices) // _FEW)
    keys = mesh.shape_keys
    points = keys.reference_key.data if keys is not None else mesh.vertices
    return len(points), *(tuple(points[at].co) for at in range(0, len(points), step))


def _why(ob, path: Path) -> str:
    try:
        before = pc2.first_frame(path, len(ob.data.vertices))
    except AnyfaceError as error:
        return f"{ob.name}: {error}"
    now = read_basis(ob.data)
    centred = [points - points.mean(axis=0) for points in (before, now)]
    sizes = [float(np.linalg.norm(points)) for points in centred]
    size = float(np.ptp(now, axis=0).max())
    by = float(np.linalg.norm(now - before, axis=1).max())
    if by <= _SAME * size:
        return ""
    scale = sizes[1] / max(sizes[0], 1e-20)
    if np.linalg.norm(centred[1] - scale * centred[0], axis=1).max() <= 10.0 * _SAME * size:
        what = f"{scale:.3g} times as large" if abs(scale - 1.0) > _SAME else "elsewhere"
    else:
        what = f"another shape, by up to {100.0 * by / size:.2g} % of its size"
    return f"{ob.name}: its mesh is {what} since its cache was made: generate again"


@persistent
def _on_load(*_) -> None:
    """Reports stale caches after a file and its linked libraries were opened."""
    _known.clear()
    for text in everywhere():
        say(f"Anyface: {text}", sys.stderr)


def register() -> None:
    """Starts to check every file that is opened."""
    bpy.app.handlers.load_post.append(_on_load)


def unregister() -> None:
    """Stops checking files."""
    bpy.app.handlers.load_post.remove(_on_load)
    _known.clear()
