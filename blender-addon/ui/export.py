"""*Export Talking Head…*: the face in a file of another program."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy.types import Operator

from ..scene import export, outputs
from .operators import Alone, WithFile
from .target import target

_KINDS = [(name, kind.label, kind.help) for name, kind in export.KINDS.items()]
_ENDINGS = {kind.ending for kind in export.KINDS.values()}


class ANYFACE_OT_export(Alone, WithFile, Operator):
    """Export the face with its motion for another program, with the right settings: the defaults \
of the FBX and USD menus leave the motion out"""

    bl_idname = "anyface.export"
    bl_label = "Export Talking Head"
    bl_options = {"REGISTER"}

    filter_glob: StringProperty(
        default=";".join(f"*{ending}" for ending in sorted(_ENDINGS)), options={"HIDDEN"}
    )
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    kind: EnumProperty(name="Format", items=_KINDS, description="What the file is for")
    whole_scene: BoolProperty(
        name="Whole Scene",
        description="Export the whole scene, not only the face with its parts and its rig",
        default=False,
    )

    @classmethod
    def why_not(cls, context):
        """Why there is nothing to export."""
        reason = super().why_not(context)
        return reason or ("" if outputs.has_take(target(context)) else "Generate first")

    def invoke(self, context, event):
        """Opens the file browser with the name of the face."""
        if not self.filepath:
            there = [name for name, kind in export.KINDS.items() if export.is_there(kind)]
            self.kind = self.kind if self.kind in there or not there else there[0]
            self.filepath = str(Path(bpy.data.filepath).with_name(target(context).name))
        self.filepath = self._path()
        return super().invoke(context, event)

    def check(self, _context):
        """Adapts the file ending to the format."""
        before, self.filepath = self.filepath, self._path()
        return before != self.filepath

    def act(self, ob):
        """Writes the file."""
        path = bpy.path.abspath(self._path())
        export.write(ob, export.KINDS[self.kind], path, self.whole_scene)
        return f"{ob.name} in {Path(path).name}"

    def _path(self) -> str:
        """The path with the ending of its format; an ending in the path chooses the format."""
        path, ending = Path(self.filepath), export.KINDS[self.kind].ending
        if path.suffix.lower() not in _ENDINGS:
            return f"{path}{ending}"
        if self.properties.is_property_set("kind"):
            return str(path.with_suffix(ending))
        self.kind = next(n for n, k in export.KINDS.items() if k.ending == path.suffix.lower())
        return str(path)
