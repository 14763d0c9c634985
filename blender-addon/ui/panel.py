"""The N-panel "Anyface" of the 3D view."""

from bpy.types import Panel

from ..scene import outputs
from . import running, words
from .target import target


class Sidebar:
    """Where panels lie; stands before `Panel`."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Anyface"


class OfFacePanel(Sidebar):
    """A panel of the character in the main one; stands before `Panel`."""

    bl_parent_id = "ANYFACE_PT_main"

    @classmethod
    def poll(cls, context):
        """False where there is no character."""
        return target(context) is not None


class ANYFACE_PT_main(Sidebar, Panel):
    """The face and the buttons; character, sound and performance are panels of their own in it."""

    bl_idname = "ANYFACE_PT_main"
    bl_label = "Anyface"

    def draw(self, context):
        """Draws the panel."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ob = target(context)
        placeholder = ob.name if ob is not None else "Active Object"
        layout.prop(context.scene.anyface, "character", placeholder=placeholder)
        if ob is None:
            layout.label(text="Pick a face mesh", icon="INFO")
            return
        _draw_buttons(layout, ob)
        _draw_report(layout, ob.anyface, context.region.width)


def _draw_buttons(layout, ob) -> None:
    if running.is_running():
        stage, fraction = running.current.progress.at
        row = layout.row()
        row.progress(factor=fraction, text=f"{running.current_name}: {words.of_stage(stage)}")
        row.operator("anyface.cancel", text="", icon="X")
        return
    row = layout.row()
    row.scale_y = 1.4
    again = outputs.has_take(ob)
    row.operator("anyface.generate", text="Generate Again" if again else "Generate")
    layout.operator("anyface.remove", icon="TRASH")


def _draw_report(layout, settings, width: int) -> None:
    if not settings.report:
        return
    box = layout.box().column(align=True)
    box.scale_y = 0.8
    box.alert = settings.report_is_error
    icon = "ERROR" if settings.report_is_error else "CHECKMARK"
    words.draw(box, settings.report, width, icon)


CLASSES = (ANYFACE_PT_main,)
