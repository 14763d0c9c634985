"""Add > Mesh > Anyface Sample Head, and what it shares with Anyface Head."""

import bpy
from bpy.props import FloatProperty
from bpy.types import Operator
from bpy_extras import object_utils

from ..scene.face import sample_head


class AddHead(object_utils.AddObjectHelper):
    """Adds a head at the 3D cursor, as the active object."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """In edit mode it would become part of another mesh."""
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave this mode first (Object Mode)")
        return context.mode == "OBJECT"

    def add(self, context, data):
        """The new object of a mesh."""
        if self.align == "VIEW" and context.region_data is None:
            # Scripts have no view to turn it to.
            self.align = "WORLD"
        return object_utils.object_data_add(context, data, operator=self)


class ANYFACE_OT_add_sample_head(AddHead, Operator):
    """Add a head with eyes, teeth and tongue to try Anyface on"""

    bl_idname = "anyface.add_sample_head"
    bl_label = "Add a Sample Head"

    height: FloatProperty(
        name="Height",
        description="Of head and shoulders; 0.38 m is that of a human",
        default=2.0,
        min=0.001,
        soft_max=10.0,
        subtype="DISTANCE",
    )

    def execute(self, context):
        """Adds it."""
        self.add(context, sample_head.mesh(self.height))
        return {"FINISHED"}


def _draw(menu, _context) -> None:
    menu.layout.operator("anyface.add_head", text="Anyface Head", icon="USER")
    menu.layout.operator("anyface.add_sample_head", text="Anyface Sample Head", icon="USER")


def register() -> None:
    """Adds both heads to Blender's menu."""
    bpy.types.VIEW3D_MT_mesh_add.append(_draw)


def unregister() -> None:
    """Takes them off."""
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw)
