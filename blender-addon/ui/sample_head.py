"""Add > Mesh > Anyface Sample Heads."""

import bpy
from bpy.props import EnumProperty, FloatProperty
from bpy.types import Menu, Operator

from ..core.errors import plain
from ..scene.face import characters, made_head, sample_head
from .add_head import AddHead, heads

PLAIN = "PLAIN"
_ITEMS = [
    (PLAIN, "Default Head", "The head of the shipped tests and pictures, without hair"),
    ("WOMAN", "Young Woman", "A young woman with her hair up"),
    ("MAN", "Old Man", "An old man with short grey hair"),
    ("CARTOON", "Big Eyes", "A stylised child with big eyes and red hair"),
]


class ANYFACE_OT_add_sample_head(AddHead, Operator):
    """Add a head with eyes, teeth and tongue to try Anyface on"""

    bl_idname = "anyface.add_sample_head"
    bl_label = "Add a Sample Head"

    character: EnumProperty(name="Character", description="Which head", items=_ITEMS, default=PLAIN)
    height: FloatProperty(
        name="Height",
        description="Height of head and shoulders; a human's is 0.38 m",
        default=2.0,
        min=0.001,
        soft_max=10.0,
        subtype="DISTANCE",
    )

    def execute(self, context):
        """Adds the head."""
        if self.character == PLAIN:
            self.add(context, sample_head.mesh(self.height))
            return {"FINISHED"}
        try:
            head = characters.make(heads(), self.character)
            ob = self.add(context, made_head.mesh(head, self.height))
            characters.dress(ob, head, self.character, self.height)
        except BaseException as error:
            self.report({"ERROR"}, f"Anyface: {plain(error)}")
            return {"CANCELLED"}
        return {"FINISHED"}


class ANYFACE_MT_sample_heads(Menu):
    """Heads to try Anyface on."""

    bl_idname = "ANYFACE_MT_sample_heads"
    bl_label = "Anyface Sample Heads"

    def draw(self, _context):
        """Draws one entry for each head."""
        for key, name, _ in _ITEMS:
            entry = self.layout.operator("anyface.add_sample_head", text=name, icon="USER")
            entry.character = key


def _draw(menu, _context) -> None:
    menu.layout.operator("anyface.add_head", text="Anyface Head", icon="USER")
    menu.layout.menu(ANYFACE_MT_sample_heads.bl_idname, icon="USER")


def register() -> None:
    """Adds the heads to Blender's menu."""
    bpy.types.VIEW3D_MT_mesh_add.append(_draw)


def unregister() -> None:
    """Removes them."""
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw)
