"""The list of shapes and keys for *Existing Keys*: found, by the names of a tool, or by hand."""

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy.types import Operator, UIList

from ..core import key_names
from ..core.key_names import Pair
from ..scene.shape_keys import artist_keys
from . import output_properties
from .operators import WithFile
from .target import OfFace, target


class ANYFACE_UL_mapping(UIList):
    """A shape, the key that shows it, and how far it goes."""

    def draw_item(self, context, layout, _data, item, _icon, _active, _name):
        """Draws one row."""
        ob = target(context)
        layout.prop(item, "shape", text="")
        if ob is not None and ob.data.shape_keys is not None:
            layout.prop_search(item, "key", ob.data.shape_keys, "key_blocks", text="")
        row = layout.row()
        row.ui_units_x = 3.0
        row.prop(item, "factor", text="")


class _OnMapping(OfFace):
    @classmethod
    def poll(cls, context):
        ob = target(context)
        return ob is not None and ob.library is None

    def _replace(self, ob, found, nothing: str):
        """Puts `found` in place of the list, or warns of `nothing`."""
        if not found:
            self.report({"WARNING"}, f"Anyface: {nothing}")
            return {"CANCELLED"}
        fill(ob, found)
        return {"FINISHED"}


class ANYFACE_OT_mapping_find(_OnMapping, Operator):
    """Fill the list with the keys whose names are known"""

    bl_idname = "anyface.mapping_find"
    bl_label = "Find Keys"

    def execute(self, context):
        """Replaces the list."""
        ob = target(context)
        text = "no key has a known name: press + and pick shapes and keys by hand"
        return self._replace(ob, artist_keys.find(ob, []), text)


class ANYFACE_OT_mapping_preset(_OnMapping, Operator):
    """Fill the list with the keys that a tool names in this way"""

    bl_idname = "anyface.mapping_preset"
    bl_label = "Names"

    preset: EnumProperty(name="Names", items=[(name, name, "") for name in key_names.presets()])

    def execute(self, context):
        """Replaces the list."""
        ob = target(context)
        blocks = ob.data.shape_keys.key_blocks if ob.data.shape_keys is not None else []
        found = key_names.pairs(self.preset, [block.name for block in blocks])
        return self._replace(ob, found, f"no key has a name of {self.preset}")


class ANYFACE_OT_mapping_add(_OnMapping, Operator):
    """Add a row: pick a shape and the key that shows it"""

    bl_idname = "anyface.mapping_add"
    bl_label = "Add Row"

    shape: StringProperty(options={"HIDDEN"})
    key: StringProperty(options={"HIDDEN"})

    def execute(self, context):
        """Adds it."""
        stored = target(context).anyface_output
        row = stored.mapping.add()
        if self.shape in row.bl_rna.properties["shape"].enum_items:
            row.shape = self.shape
        row.key, stored.mapping_index = self.key, len(stored.mapping) - 1
        return {"FINISHED"}


class ANYFACE_OT_mapping_remove(_OnMapping, Operator):
    """Take the active row off the list"""

    bl_idname = "anyface.mapping_remove"
    bl_label = "Remove Row"

    def execute(self, context):
        """Takes it off."""
        stored = target(context).anyface_output
        if not 0 <= stored.mapping_index < len(stored.mapping):
            self.report({"ERROR"}, "Anyface: choose a row of the list first")
            return {"CANCELLED"}
        stored.mapping.remove(stored.mapping_index)
        stored.mapping_index = max(0, min(stored.mapping_index, len(stored.mapping) - 1))
        return {"FINISHED"}


class ANYFACE_OT_mapping_clear(_OnMapping, Operator):
    """Empty the list; keys are found by name again"""

    bl_idname = "anyface.mapping_clear"
    bl_label = "Clear"

    def execute(self, context):
        """Empties the list."""
        target(context).anyface_output.mapping.clear()
        return {"FINISHED"}


class ANYFACE_OT_mapping_save(_OnMapping, WithFile, Operator):
    """Save the list as a JSON file"""

    bl_idname = "anyface.mapping_save"
    bl_label = "Save Key List"
    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        """Asks for the file."""
        self.filepath = self.filepath or f"{target(context).name}_keys.json"
        return super().invoke(context, event)

    def act(self, ob):
        """Writes the list, or what is found by name where it is empty."""
        found = output_properties.read(ob).mapping or artist_keys.find(ob, [])
        path = bpy.path.ensure_ext(bpy.path.abspath(self.filepath), ".json")
        key_names.write(found, Path(path))


class ANYFACE_OT_mapping_load(_OnMapping, WithFile, Operator):
    """Load the list from a JSON file"""

    bl_idname = "anyface.mapping_load"
    bl_label = "Load Key List"

    def act(self, ob):
        """Replaces the list by that of the file."""
        fill(ob, key_names.read(Path(bpy.path.abspath(self.filepath))))


def fill(ob, pairs: list[Pair]) -> None:
    """Replaces the list of `ob`."""
    rows = ob.anyface_output.mapping
    rows.clear()
    for pair in pairs:
        row = rows.add()
        row.shape, row.key, row.factor = pair.shape, pair.key, pair.factor


CLASSES = (
    ANYFACE_UL_mapping,
    ANYFACE_OT_mapping_find,
    ANYFACE_OT_mapping_preset,
    ANYFACE_OT_mapping_add,
    ANYFACE_OT_mapping_remove,
    ANYFACE_OT_mapping_clear,
    ANYFACE_OT_mapping_save,
    ANYFACE_OT_mapping_load,
)
