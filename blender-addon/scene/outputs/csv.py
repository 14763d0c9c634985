"""A take as a table of ARKit weights; the mesh stays as it is."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy

from ...core import json_file, plan, wording
from ...core.errors import AnyfaceError
from ...core.estimate import RIG_S, SOLVE_S, Cost
from ...core.job import BEGUN
from ...core.plan import WriteTable
from ...core.redo_film import PatchTable
from .. import identity
from ..shape_keys import guard
from .output import Output, check_place

PROPERTY = "anyface_csv"
# Bytes of a number in a table, and the number of columns.
_NUMBER, _COLUMNS = 9, 63
_SUFFIX = ".csv"


@dataclass
class _Note:
    """The path of a table, the id of its object, and the digest of the table and name of the .blend
    when it was written."""

    path: str
    owner: str
    digest: str
    blend: str = ""


class Csv(Output):
    """A table file; a custom property of the object stores its path for Remove."""

    name = "csv"
    label = "ARKit Table"
    help = "A Live Link Face CSV file; the mesh stays as it is"
    on_mesh = False
    moves_parts = False
    needs_face = False
    in_files = True
    options = ("csv_file",)

    def check_object(self, ob):
        guard.check_mesh(ob)

    def check(self, ob, settings):
        super().check(ob, settings)
        check_place(settings.csv_file)
        path = _path_of(ob, settings.csv_file)
        if path.suffix.lower() != _SUFFIX:
            raise AnyfaceError("file", f"{path}: expected a name that ends in .csv")
        if path.exists() and not self._is_ours(ob, path):
            raise AnyfaceError("file", f"{path} exists already: choose another name or delete it")

    def cost(self, workload):
        return Cost(workload.frames * _COLUMNS * _NUMBER, SOLVE_S, RIG_S, beside=True)

    def plan(self, ob, settings, fps, objects):
        return WriteTable(ob.name, str(_path_of(ob, settings.csv_file)))

    def describe(self, take):
        (file,) = take.motion.files
        shown = f"it shows {wording.share(1.0 - file.left_out)}"
        return f"ARKit table {bpy.path.basename(file.path)}, {shown}"

    def write_files(self, ob, take, start_frame, scene_fps):
        (file,) = take.motion.files
        path = _path_of(ob, file.path)
        plan.put(file)
        # A linked object cannot store the path.
        if ob.library is None:
            note = _Note(str(path), identity.of(ob), _digest(path), _blend())
            ob[PROPERTY] = json.dumps(asdict(note))

    def find(self, ob):
        note = json_file.record(_Note, ob.get(PROPERTY))
        # A copy of the object has the same note, but the table belongs to the original.
        if note is None or note.owner != identity.known(ob):
            return None
        # Anybody may have written the note: no file of another kind is read or deleted.
        path = Path(note.path)
        return path if path.suffix.lower() == _SUFFIX and "\0" not in note.path else None

    def span(self, ob, snapshot):
        start, step, _ = super().span(ob, snapshot)
        with open(self.find(ob), encoding="utf-8") as table:
            return start, step, sum(1 for _ in table) - 1

    def redo_plan(self, ob, snapshot, first, shares):
        return PatchTable(snapshot.plan, str(self.find(ob)), first, shares)

    def redo_write(self, parts, snapshot, take, first, at, stretch):
        self.write_files(parts[0], take, at[0], snapshot.scene_fps)
        yield BEGUN

    def remove(self, ob):
        """Deletes the table, unless somebody has changed it."""
        path = self.find(ob)
        if path is None or ob.library is not None:
            return
        if self._is_ours(ob, path):
            path.unlink()
        del ob[PROPERTY]

    def _is_ours(self, ob, path: Path) -> bool:
        if self.find(ob) != path or not path.is_file():
            return False
        note = json_file.record(_Note, ob.get(PROPERTY))
        # A .blend that was saved under another name points to the same table, but does not own it.
        return note.blend == _blend() and note.digest == _digest(path)


def _path_of(ob, path: str) -> Path:
    """The path of the table; by default beside the .blend, named after it and the object."""
    name = f"{Path(_blend()).stem}_{bpy.path.clean_name(ob.name)}.csv"
    return Path(bpy.path.abspath(path or f"//{name}"))


def _blend() -> str:
    """The name of this version of the .blend; empty before it is saved."""
    return Path(bpy.data.filepath).name


def _digest(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=12).hexdigest()
