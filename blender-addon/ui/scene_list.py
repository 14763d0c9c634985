"""The list of a scene's characters and their strips, and the button that animates them all."""

import bpy
from bpy.props import BoolProperty, CollectionProperty, IntProperty, PointerProperty, StringProperty
from bpy.types import Operator, Panel, PropertyGroup

from ..core.errors import AnyfaceError
from ..scene import scene_list
from ..scene.sound import sequencer, strips
from . import audio, running
from .operators import InThread
from .panel import OfMorePanel
from .settings import from_object
from .target import sequencer_scene


class AnyfaceSceneRow(PropertyGroup):
    """One character of the scene."""

    use: BoolProperty(name="Use", description="Animate this character", default=True, options=set())
    strip: StringProperty(
        name="Strip",
        description="Empty uses the sound set in the character's own panel",
        options=set(),
    )
    character: PointerProperty(
        name="Face",
        type=bpy.types.Object,
        poll=lambda _self, ob: ob.type == "MESH",
        options=set(),
    )


class ANYFACE_PT_scene(OfMorePanel, Panel):
    """Strips and characters."""

    bl_label = "Scene"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the list."""
        layout, scene = self.layout, sequencer_scene(context)
        column = layout.column(align=True)
        for number, row in enumerate(context.scene.anyface_list):
            line = column.row(align=True)
            line.prop(row, "use", text="")
            audio.search_strip(line, row, "strip", scene.sequence_editor, text="")
            line.prop(row, "character", text="")
            line.operator("anyface.scene_row_remove", text="", icon="X").number = number
        line = layout.row(align=True)
        line.operator("anyface.scene_row_add", icon="ADD")
        line.operator("anyface.scene_fill", icon="FILE_REFRESH")
        layout.operator("anyface.generate_scene", icon="PLAY")


class ANYFACE_OT_scene_row_add(Operator):
    """Add a row for each selected mesh, or an empty one"""

    bl_idname = "anyface.scene_row_add"
    bl_label = "Add"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Adds rows, but none for a mesh that is in the list already."""
        rows = context.scene.anyface_list
        there = {row.character for row in rows}
        for ob in [ob for ob in context.selected_objects if ob.type == "MESH"] or [None]:
            if ob is None or ob not in there:
                rows.add().character = ob
        return {"FINISHED"}


class ANYFACE_OT_scene_fill(Operator):
    """Add a row for each sound strip that has none"""

    bl_idname = "anyface.scene_fill"
    bl_label = "From Strips"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Adds the missing rows, each with the character whose panel or name matches the strip."""
        rows = context.scene.anyface_list
        there = {row.strip for row in rows}
        for strip in sequencer.sound_strips(sequencer_scene(context)):
            if strip.name not in there:
                row = rows.add()
                row.strip, row.character = strip.name, _speaker(strip.name, context.scene)
        return {"FINISHED"}


def _speaker(strip: str, scene):
    """The mesh whose panel names a strip, or else whose name is part of the strip's name."""
    meshes = [ob for ob in scene.objects if ob.type == "MESH"]
    for ob in meshes:
        if ob.anyface.strip == strip:
            return ob
    return strips.named_in(strip, meshes)


class ANYFACE_OT_scene_row_remove(Operator):
    """Remove this row from the list; the character itself stays"""

    bl_idname = "anyface.scene_row_remove"
    bl_label = "Remove Row"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty(options={"HIDDEN"})

    def execute(self, context):
        """Removes the row."""
        context.scene.anyface_list.remove(self.number)
        return {"FINISHED"}


class ANYFACE_OT_generate_scene(InThread, Operator):
    """Animate every character of the list"""

    bl_idname = "anyface.generate_scene"
    bl_label = "Generate All"

    # If a row fails, only that row is undone.
    goes_back = False

    @classmethod
    def why_not(cls, context):
        if running.is_running():
            return "Another face is being animated"
        there = any(row.use and row.character for row in context.scene.anyface_list)
        return "" if there else "The list has no character"

    def face(self, context):
        """None: it works on all characters of the list."""
        return None

    def read(self, context, _ob):
        """Reads the settings, the meshes and the sounds."""
        said, rows = {}, []
        for row in context.scene.anyface_list:
            if row.use and row.character is not None:
                said.setdefault(row.character, []).extend([row.strip] if row.strip else [])
        for ob, names in said.items():
            settings = from_object(ob)
            if names:
                # A single strip is used even if it is muted.
                alone = len(names) == 1
                settings.strip, settings.strips = (names[0], []) if alone else ("", names)
                settings.sound_file, settings.channel = "", 0
            rows.append((ob, settings, running.engine(settings.system)))
        return scene_list.read(sequencer_scene(context), rows)

    def finish(self, _ob, snapshot, takes):
        """Writes the takes."""
        outcomes = scene_list.write(snapshot, takes)
        self._written = any(ok for _, ok, _ in outcomes)
        text = scene_list.in_one_line(outcomes)
        if not self._written:
            raise AnyfaceError("mesh", text)
        if all(ok for _, ok, _ in outcomes):
            return text
        self.report({"WARNING"}, f"Anyface: {text}")


def register() -> None:
    """Adds the list to scenes."""
    bpy.utils.register_class(AnyfaceSceneRow)
    bpy.types.Scene.anyface_list = CollectionProperty(type=AnyfaceSceneRow)


def unregister() -> None:
    """Removes it; rows stay in the file."""
    del bpy.types.Scene.anyface_list
    bpy.utils.unregister_class(AnyfaceSceneRow)
