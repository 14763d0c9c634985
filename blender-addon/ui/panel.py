"""The N-panel "Anyface" of the 3D view: the essentials on one screen, the rest under *More*."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty
from bpy.types import Panel

from ..scene import live, outputs, stale
from . import audio, mending, mixture, presets, running, words
from .operators import redraw
from .target import sequencer_scene, target

# The manual, which is part of the zip.
HELP = Path(__file__).resolve().parents[1] / "help.txt"
# A name takes this share of its line, as in Blender's property split.
_NAME_SHARE = 0.4


class Sidebar:
    """The place of panels; stands before `Panel`."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Anyface"


class OfMorePanel(Sidebar):
    """A panel under *More*; stands before `Panel`."""

    bl_parent_id = "ANYFACE_PT_main"

    @classmethod
    def poll(cls, context):
        """False while *More* is closed."""
        return context.window_manager.anyface_more


class OfFacePanel(OfMorePanel):
    """A panel of the character under *More*; a base before `Panel`."""

    @classmethod
    def poll(cls, context):
        """False if there is no character, and while *More* is closed."""
        return super().poll(context) and target(context) is not None


class ANYFACE_PT_main(Sidebar, Panel):
    """Face, sound, style, emotion, the button, and the report."""

    bl_label = "Anyface"

    def draw_header_preset(self, _context):
        """Draws the link to the manual at the right of the header."""
        if HELP.is_file():
            link = self.layout.operator("wm.path_open", text="", icon="HELP", emboss=False)
            link.filepath = str(HELP)

    def draw(self, context):
        """Draws the panel."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        ob = target(context)
        placeholder = ob.name if ob is not None else "Active Object"
        layout.prop(context.scene.anyface, "character", placeholder=placeholder)
        if ob is None:
            layout.label(text="Click a face, or add one:", icon="INFO")
            layout.operator("anyface.add_sample_head", icon="USER")
        else:
            audio.draw(layout.column(), ob, sequencer_scene(context), context.region.width)
            _draw_performance(layout, ob.anyface)
            _draw_buttons(layout, context, ob)
            _draw_report(layout, ob, context.region.width)
        header, _ = layout.panel_prop(context.window_manager, "anyface_more")
        header.label(text="More")


def named(layout, name: str):
    """Adds a line whose left part is a name; returns the right part."""
    split = layout.split(factor=_NAME_SHARE)
    left = split.row()
    left.alignment = "RIGHT"
    left.label(text=name)
    return split.row(align=True)


def _draw_performance(layout, settings) -> None:
    column = layout.column(align=True)
    named(column, "Style").menu("ANYFACE_MT_presets", text=presets.name_of(settings))
    if settings.emotion_source != "GIVEN":
        column.prop(settings, "emotion_source")
        return
    mixture.draw(lambda name: named(column, name), settings)


def _draw_buttons(layout, context, ob) -> None:
    if running.is_running():
        stage, fraction = running.current.progress.at
        row = layout.row()
        row.scale_y = 1.4
        row.progress(factor=fraction, text=f"{running.current_name}: {words.of_stage(stage)}")
        row.operator("anyface.cancel", text="", icon="X")
        return
    again = outputs.has_take(ob)
    row = layout.row()
    row.scale_y = 1.4
    row.operator("anyface.generate", text="Generate Again" if again else "Generate")
    if not again:
        hears = live.listens(ob)
        row.operator("anyface.live", text="", icon="PLAY", depress=live.is_on(ob) and not hears)
        row.operator("anyface.listen", text="", icon="OUTLINER_DATA_SPEAKER", depress=hears)
        _draw_listener(layout, live.listener(ob))
    if again:
        layout.operator("anyface.remove", icon="TRASH")


def _draw_listener(layout, face) -> None:
    if face is None:
        return
    row = layout.row(align=True)
    if face.is_lost:
        row.label(text=f"{face.name} is gone: the face waits for it", icon="ERROR")
        return
    text = "Stop Recording" if face.is_recording else "Record"
    row.operator("anyface.record", text=text, icon="REC", depress=face.is_recording)


def _draw_report(layout, ob, width: int) -> None:
    settings = ob.anyface
    if settings.report:
        box = layout.box().column(align=True)
        box.scale_y = 0.8
        box.alert = settings.report_is_error
        icon = "ERROR" if settings.report_is_error else "CHECKMARK"
        words.draw(box, settings.report, width, icon)
        if settings.report_details and not settings.report_is_error:
            _draw_details(box, settings.report_details, width)
    old = stale.of(ob)
    if old and not running.is_running():
        box = layout.box().column(align=True)
        box.alert = True
        words.draw(box, old, width, "ERROR")
    mending.draw(layout, ob, width)


def _draw_details(box, text: str, width: int) -> None:
    manager = bpy.context.window_manager
    icon = "DISCLOSURE_TRI_DOWN" if manager.anyface_details else "DISCLOSURE_TRI_RIGHT"
    row = box.row()
    row.alignment = "LEFT"
    row.prop(manager, "anyface_details", icon=icon, emboss=False)
    if manager.anyface_details:
        words.draw(box, text, width)


def register() -> None:
    """Adds the properties that open *More* and the details of the report."""
    bpy.types.WindowManager.anyface_more = BoolProperty(
        name="More",
        description="Face, performance, life, output and takes in detail",
        update=lambda _self, context: redraw(context),
    )

    bpy.types.WindowManager.anyface_details = BoolProperty(
        name="Details",
        description="How far the face moves, and how exact the take is",
        update=lambda _self, context: redraw(context),
    )


def unregister() -> None:
    """Removes both."""
    del bpy.types.WindowManager.anyface_details
    del bpy.types.WindowManager.anyface_more
