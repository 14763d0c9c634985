"""Finds the face controls of a rig, or takes them from a list of names."""

import bpy
import numpy as np
from bpy.props import EnumProperty
from bpy.types import Operator

from ..core import control_names, controls_plan
from ..core.control_names import Row
from ..core.errors import AnyfaceError
from ..core.job import at_once
from ..core.take import ControlMotion, Found
from ..scene.rig_controls import control_actions, control_bench, control_fit, control_sources
from ..scene.rig_controls.control_kinds import COLLECTIONS
from . import landmarks, output_properties
from .operators import Acting, InThread, Notice, ToFile, WithFile
from .target import is_there

# The distance of the temples on a head of human size, mm.
_TEMPLES_MM = 140.0
_PRESETS = [(name, name, "") for name in control_names.presets()]


class ANYFACE_OT_controls_find(InThread, Operator):
    """Try the bones of the rig and the properties that its drivers read, and list those that move \
the face"""

    bl_idname = "anyface.controls_find"
    bl_label = "Find Controls"

    def read(self, context, ob):
        """Reads the mesh for a search of its landmarks, which tell where the face is."""
        control_bench.check(ob)
        return landmarks.search_of(ob)

    def land(self, ob, search, face_points):
        """Nudges each control that may move the face, and lists those that do."""
        sources = _sources(ob)
        motion = _still(search.face.positions[: len(ob.data.vertices)], face_points)
        bench = control_bench.Bench(ob, control_fit.rigs_of(sources), motion.vertices)
        rests = control_actions.rests(ob)
        handles = yield from control_fit.try_all(ob, bench, motion, sources, rests)
        moving = {handle.source.key for handle in handles}
        listed = [source for source in sources if source.key in moving]
        if not listed:
            raise AnyfaceError("mesh", f"no control moves the face of {ob.name}: pick its rig")
        _list(ob, listed)
        return f"{len(listed)} controls move the face"

    def finish(self, ob, search, face_points):
        """Does what `land` does, all at once."""
        return at_once(self.land(ob, search, face_points))


class ANYFACE_OT_controls_preset(Acting, Operator):
    """Fill the list with the bones that this tool names"""

    bl_idname = "anyface.controls_preset"
    bl_label = "Names"

    preset: EnumProperty(name="Names", items=_PRESETS)

    def act(self, ob):
        """Replaces the list."""
        rig = _rig(ob)
        sources = control_sources.of_preset(rig, self.preset) if rig is not None else []
        if not sources:
            raise Notice(f"the rig has no bone with a name of {self.preset}")
        _list(ob, sources)


class ANYFACE_OT_controls_clear(Acting, Operator):
    """Empty the list; controls are found when you generate"""

    bl_idname = "anyface.controls_clear"
    bl_label = "Clear"

    def act(self, ob):
        """Empties the list."""
        ob.anyface_controls.rows.clear()


class ANYFACE_OT_controls_save(ToFile, Operator):
    """Save the list as a JSON file, for other scenes with this rig"""

    bl_idname = "anyface.controls_save"
    bl_label = "Save Control List"

    what = "controls"

    def act(self, ob):
        """Writes the list."""
        rows = ob.anyface_controls.rows
        if not len(rows):
            raise AnyfaceError("input", "the list is empty: press Find Controls first")
        fields = ("kind", "id_type", "block", "path", "sided", "use")
        table = [Row(*(getattr(row, name) for name in fields)) for row in rows]
        control_names.write(table, self.path)


class ANYFACE_OT_controls_load(WithFile, Operator):
    """Load the list from a JSON file; if its rig is not in this scene, this rig is used"""

    bl_idname = "anyface.controls_load"
    bl_label = "Load Control List"

    def act(self, ob):
        """Replaces the list with the controls from the file that exist here."""
        rows = control_names.read(self.path)
        pairs = [(_here(row, _rig(ob)), row.use) for row in rows]
        there = [pair for pair in pairs if pair[0] is not None]
        if not there:
            raise AnyfaceError("input", f"{ob.name} has none of the {len(rows)} controls")
        _list(ob, [source for source, _ in there])
        for row, (_, use) in zip(ob.anyface_controls.rows, there, strict=True):
            row.use = use
        lost = len(rows) - len(there)
        return f"{len(there)} controls" + (f", {lost} are not here" if lost else "")


def _here(row: Row, rig) -> control_sources.Source | None:
    """The source that a row of a file names, or None. `rig` replaces a missing data-block."""
    block = row.block
    known = COLLECTIONS.get(row.id_type)
    if known is None or row.kind not in (control_sources.BONE, control_sources.NUMBER):
        return None
    if getattr(bpy.data, known).get(block) is None and rig is not None:
        block = rig.name if row.id_type == "OBJECT" else rig.data.name
    try:
        return control_sources.find(row.kind, row.id_type, block, row.path, row.sided)
    except AnyfaceError:
        return None


def _rig(ob):
    stored = ob.anyface_controls
    return stored.rig if is_there(stored.rig) else control_sources.rig_of(ob)


def _sources(ob) -> list[control_sources.Source]:
    return control_sources.propose(ob, _rig(ob), output_properties.read(ob).left_alone)


def _still(positions: np.ndarray, face_points: Found) -> ControlMotion:
    """The skin vertices near the landmarks, as a motion without frames."""
    vertices, regions = controls_plan.nearby(positions, face_points)
    mm = _TEMPLES_MM / max(
        float(np.linalg.norm(face_points.positions[0] - face_points.positions[16])), 1e-12
    )
    frames = np.zeros((0, len(vertices), 3), dtype=np.float32)
    return ControlMotion(vertices, frames, regions, np.empty((0, 2), dtype=np.int64), mm)


def _list(ob, sources: list[control_sources.Source]) -> None:
    """Replaces the list of `ob`."""
    rows = ob.anyface_controls.rows
    rows.clear()
    for source in sources:
        row = rows.add()
        row.name, row.kind, row.sided = source.label, source.kind, source.sided
        row.id_type, row.block, row.path = source.block.id_type, source.block.name, source.name
