"""Point caches on disk: how they are named, and which of them are no longer used.

A file name contains the version of the .blend, the object and the take, so no run overwrites a file
of another run. Only *Remove Unused Caches* deletes caches, and only if no .blend nearby names them.
"""

import gzip
import mmap
import re
import uuid
from dataclasses import dataclass
from pathlib import Path

import bpy

from ..core.errors import AnyfaceError

# Folders of this name are ours. They are deleted once they are empty.
FOLDER = "anyface_cache"
SUFFIX = ".pc2"
_OURS = re.compile(r".+_[0-9a-f]{8}\.pc2")
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"


@dataclass
class Unused:
    """The `files` that can be deleted, and the `unread` .blend files, which could not be read.

    Caches near an unread .blend stay.
    """

    files: list[Path]
    unread: list[Path]

    @property
    def megabytes(self) -> float:
        """The space that deleting the files frees, MB."""
        return sum(path.stat().st_size for path in self.files) / 1e6


def names(objects: list[str]) -> dict[str, str]:
    """The file names for a new take, by the name of each object."""
    version = Path(bpy.data.filepath).stem or "untitled"
    take = uuid.uuid4().hex[:8]
    clean = bpy.path.clean_name
    return {name: f"{clean(version)}_{clean(name)}_{take}{SUFFIX}" for name in objects}


def take_of(path: str) -> str:
    """The part of a file name that all files of a take share."""
    return Path(path).stem.rpartition("_")[2]


def unused() -> Unused:
    """The caches beside this .blend, and in folders that it plays from, that no .blend names.

    It searches the .blend files beside each cache folder, in the folders next to it, and in the
    folders next to its parent.
    """
    played = _played()
    folders = {path.parent for path in played}
    if bpy.data.filepath:
        folders.add(Path(bpy.data.filepath).parent / FOLDER)
    result = Unused([], [])
    for folder in sorted(folder for folder in folders if folder.is_dir()):
        files = [path for path in folder.iterdir() if _OURS.fullmatch(path.name)]
        spare = [path for path in files if path.resolve() not in played]
        _add_unnamed(spare, folder.parent, result)
    return result


def delete(files: list[Path]) -> None:
    """Deletes caches, and our folders if that leaves them empty."""
    try:
        for path in files:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise AnyfaceError("file", f"{path}: {error.strerror or error}") from error
    for folder in {path.parent for path in files}:
        if folder.name == FOLDER and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _add_unnamed(spare: list[Path], beside: Path, result: Unused) -> None:
    """Adds the `spare` files that no .blend near `beside` names to `result`; backups count too."""
    places = (beside.glob("*.blend*"), beside.glob("*/*.blend*"), beside.parent.glob("*/*.blend*"))
    for blend in {path for place in places for path in place if path.is_file()} if spare else ():
        named = _named_in(blend, [path.name for path in spare])
        if named is None:
            result.unread.append(blend)
            return
        spare = [path for path in spare if path.name not in named]
    result.files += spare


def _named_in(blend: Path, candidates: list[str]) -> set[str] | None:
    """The file names from `candidates` that a .blend contains; None if it cannot be read here."""
    try:
        with open(blend, "rb") as file:
            start = file.read(4)
            if start == _ZSTD:
                content = _unzstd(blend)
            elif start.startswith(_GZIP):
                content = gzip.decompress(blend.read_bytes())
            else:
                content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if start else b""
            return {name for name in candidates if content.find(name.encode()) >= 0}
    except (OSError, EOFError, ValueError, ImportError):
        return None


def _unzstd(blend: Path) -> bytes:
    import zstandard

    try:
        with open(blend, "rb") as file:
            unpacked = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
            return unpacked.read()
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _played() -> set[Path]:
    modifiers = (modifier for ob in bpy.data.objects for modifier in ob.modifiers)
    caches = [modifier for modifier in modifiers if modifier.type == "MESH_CACHE"]
    paths = [bpy.path.abspath(m.filepath, library=m.id_data.library) for m in caches if m.filepath]
    return {Path(path).resolve() for path in paths}
