"""The list of takes: switch, rename, push down to the NLA, delete."""

from bpy.props import StringProperty
from bpy.types import Operator, Panel

from ..scene.shape_keys import record
from ..scene.takes import take_list
from .operators import Alone
from .panel import OfFacePanel
from .target import target

_ICONS = {"PLAYS": "RADIOBUT_ON", "WAITS": "RADIOBUT_OFF", "NLA": "NLA"}


class ANYFACE_PT_takes(OfFacePanel, Panel):
    """The takes of one character."""

    bl_label = "Takes"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the list."""
        layout, ob = self.layout, target(context)
        layout.prop(ob.anyface_output, "new_take")
        column = layout.column(align=True)
        for row in take_list.rows(ob):
            line = column.row(align=True)
            switch = line.operator("anyface.take_switch", text=row.name, icon=_ICONS[row.state])
            switch.take = row.id
            rename = line.operator("anyface.take_rename", text="", icon="GREASEPENCIL")
            rename.take, rename.name = row.id, row.name
            line.operator("anyface.take_push_down", text="", icon="NLA_PUSHDOWN").take = row.id
            line.operator("anyface.take_delete", text="", icon="TRASH").take = row.id
        layout.operator("anyface.take_keep")
        layout.operator("anyface.performer_learn")


class ANYFACE_OT_take_keep(Alone, Operator):
    """Keep this take in the list; the next one is added beside it"""

    bl_idname = "anyface.take_keep"
    bl_label = "Keep Take"

    @classmethod
    def why_not(cls, context):
        plays = record.is_generated(target(context))
        return super().why_not(context) or ("" if plays else "No take plays")

    def act(self, ob):
        """Sets the playing take aside: it waits in the list."""
        take_list.keep(ob)


class _OneTake(Alone):
    take: StringProperty(options={"HIDDEN"})

    @classmethod
    def why_not(cls, context):
        takes = take_list.rows(target(context))
        return super().why_not(context) or ("" if takes else "There are no takes")


class ANYFACE_OT_take_switch(_OneTake, Operator):
    """Play this take instead of the other"""

    bl_idname = "anyface.take_switch"
    bl_label = "Play Take"

    def act(self, ob):
        """Switches to the take."""
        take_list.switch(ob, self.take)


class ANYFACE_OT_take_rename(_OneTake, Operator):
    """Give the take another name"""

    bl_idname = "anyface.take_rename"
    bl_label = "Rename Take"

    name: StringProperty(name="Name")

    def invoke(self, context, event):
        """Asks for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def act(self, ob):
        """Renames the take."""
        take_list.rename(ob, self.take, self.name)


class ANYFACE_OT_take_push_down(_OneTake, Operator):
    """Put the take as a strip into the NLA editor, where takes can be moved and blended"""

    bl_idname = "anyface.take_push_down"
    bl_label = "Push Down"

    def act(self, ob):
        """Pushes the take down."""
        take_list.push_down(ob, self.take)


class ANYFACE_OT_take_delete(_OneTake, Operator):
    """Delete the take with its keys, its action and its strip"""

    bl_idname = "anyface.take_delete"
    bl_label = "Delete Take"

    def act(self, ob):
        """Deletes the take."""
        take_list.delete(ob, self.take)
