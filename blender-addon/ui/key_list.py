"""The list of shapes and keys for *Existing Keys*, by known names, a tool's names, or by hand."""

from bpy.props import EnumProperty, StringProperty
from bpy.types import Operator, UIList

from ..core import key_names
from ..core.errors import AnyfaceError
from ..core.key_names import Pair
from ..scene.shape_keys import artist_keys
from . import output_properties
from .operators import Notice, OnList, ToFile, WithFile
from .target import target


class ANYFACE_UL_mapping(UIList):
    """A shape, the key that shows it, and its share."""

    def draw_item(self, context, layout, _data, item, _icon, _active, _name):
        """Draws one row."""
        ob = target(context)
        layout.prop(item, "shape", text="")
        if ob is not None and ob.data.shape_keys is not None:
            layout.prop_search(item, "key", ob.data.shape_keys, "key_blocks", text="")
        row = layout.row()
        row.ui_units_x = 3.0
        row.prop(item, "factor", text="")


class ANYFACE_OT_mapping_find(OnList, Operator):
    """Fill the list with the keys whose names are known"""

    bl_idname = "anyface.mapping_find"
    bl_label = "Find Keys"

    def act(self, ob):
        """Replaces the list."""
        pairs = artist_keys.full(ob, [])
        if not pairs:
            raise Notice("no key has a known name: press + and pick shapes and keys by hand")
        fill(ob, pairs)


class ANYFACE_OT_mapping_preset(OnList, Operator):
    """Fill the list with the keys that this tool names"""

    bl_idname = "anyface.mapping_preset"
    bl_label = "Names"

    preset: EnumProperty(name="Names", items=[(name, name, "") for name in key_names.presets()])

    def act(self, ob):
        """Replaces the list."""
        blocks = ob.data.shape_keys.key_blocks if ob.data.shape_keys is not None else []
        pairs = key_names.pairs(self.preset, [block.name for block in blocks])
        if not pairs:
            raise Notice(f"no key has a name of {self.preset}")
        fill(ob, pairs)


class ANYFACE_OT_mapping_add(OnList, Operator):
    """Add a row: pick a shape and the key that shows it"""

    bl_idname = "anyface.mapping_add"
    bl_label = "Add Row"

    shape: StringProperty(options={"HIDDEN"})
    key: StringProperty(options={"HIDDEN"})

    def act(self, ob):
        """Adds the row."""
        stored = ob.anyface_output
        row = stored.mapping.add()
        if self.shape in row.bl_rna.properties["shape"].enum_items:
            row.shape = self.shape
        row.key, stored.mapping_index = self.key, len(stored.mapping) - 1


class ANYFACE_OT_mapping_remove(OnList, Operator):
    """Remove the active row from the list"""

    bl_idname = "anyface.mapping_remove"
    bl_label = "Remove Row"

    def act(self, ob):
        """Removes the row."""
        stored = ob.anyface_output
        if not 0 <= stored.mapping_index < len(stored.mapping):
            raise AnyfaceError("input", "choose a row of the list first")
        stored.mapping.remove(stored.mapping_index)
        stored.mapping_index = max(0, min(stored.mapping_index, len(stored.mapping) - 1))


class ANYFACE_OT_mapping_clear(OnList, Operator):
    """Empty the list; keys are found by name again"""

    bl_idname = "anyface.mapping_clear"
    bl_label = "Clear"

    def act(self, ob):
        """Empties the list."""
        ob.anyface_output.mapping.clear()


class ANYFACE_OT_mapping_save(OnList, ToFile, Operator):
    """Save the list as a JSON file"""

    bl_idname = "anyface.mapping_save"
    bl_label = "Save Key List"

    what = "keys"

    def act(self, ob):
        """Writes the list, or the keys with known names if the list is empty."""
        pairs = output_properties.read(ob).mapping or artist_keys.find(ob, [])
        key_names.write(pairs, self.path)


class ANYFACE_OT_mapping_load(OnList, WithFile, Operator):
    """Load the list from a JSON file"""

    bl_idname = "anyface.mapping_load"
    bl_label = "Load Key List"

    def act(self, ob):
        """Replaces the list with the one from the file."""
        fill(ob, key_names.read(self.path))


def fill(ob, pairs: list[Pair]) -> None:
    """Replaces the list of `ob`."""
    rows = ob.anyface_output.mapping
    rows.clear()
    for pair in pairs:
        row = rows.add()
        row.shape, row.key, row.factor = pair.shape, pair.key, pair.factor
