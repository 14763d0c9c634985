"""The files of removed caches: kept as long as an undo or the saved .blend may need them.

Without a window nothing is undone, and a file goes at once. With one it goes when the .blend is
closed or Blender ends, once the .blend was saved without it; earlier only where such files pile up.
"""

from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

# Folders of this name are ours and go when they are empty.
FOLDER = "anyface_cache"
SUFFIX = ".pc2"
# More than these bytes are not kept for undo alone.
LIMIT = 4_000_000_000


@dataclass
class Waiting:
    """A file that no modifier plays; `saved_in` is the .blend on disk that still does, or ""."""

    path: Path
    saved_in: str


_waiting: list[Waiting] = []
# Files written since the .blend was saved: on disk it does not know them.
_fresh: set[str] = set()


def note_written(path: str) -> None:
    """A modifier has begun to play `path`."""
    _fresh.add(str(path))


def drop(path: Path) -> None:
    """The modifier that played `path` is gone."""
    if path.suffix != SUFFIX:
        return
    if not _has_undo():
        _delete(path)
        return
    _waiting.append(Waiting(path, "" if str(path) in _fresh else bpy.data.filepath))
    _keep_within(LIMIT)


def purge() -> None:
    """Deletes what nobody needs any more; undo ends here."""
    _keep_within(0)
    _waiting.clear()
    _fresh.clear()


def _keep_within(limit: int) -> None:
    """Deletes files that only an undo could ask for, the oldest first, until `limit` bytes stay."""
    played = _played()
    spare = [w for w in _waiting if not w.saved_in and str(w.path) not in played]
    sizes = [w.path.stat().st_size if w.path.is_file() else 0 for w in spare]
    for number, waiting in enumerate(spare):
        if limit and sum(sizes[number:]) <= limit:
            return
        _delete(waiting.path)
        _waiting.remove(waiting)


def _has_undo() -> bool:
    return not bpy.app.background


def _delete(path: Path) -> None:
    if str(path) in _played():
        return
    path.unlink(missing_ok=True)
    if path.parent.name == FOLDER and path.parent.is_dir() and not any(path.parent.iterdir()):
        path.parent.rmdir()


def _played() -> set[str]:
    modifiers = (modifier for ob in bpy.data.objects for modifier in ob.modifiers)
    return {bpy.path.abspath(m.filepath) for m in modifiers if m.type == "MESH_CACHE"}


@persistent
def _on_save(path: str = "", *_) -> None:
    """The .blend on disk plays what is played now; one of another name plays what it did."""
    if path and Path(path) != Path(bpy.data.filepath):
        return
    _fresh.clear()
    for waiting in _waiting:
        if waiting.saved_in == bpy.data.filepath:
            waiting.saved_in = ""


@persistent
def _on_load(*_) -> None:
    purge()


def register() -> None:
    """Watches for the .blend being saved and another being opened."""
    bpy.app.handlers.save_post.append(_on_save)
    bpy.app.handlers.load_pre.append(_on_load)


def unregister() -> None:
    """Blender ends, or the add-on is disabled."""
    purge()
    bpy.app.handlers.save_post.remove(_on_save)
    bpy.app.handlers.load_pre.remove(_on_load)
