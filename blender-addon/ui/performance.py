"""Performance in detail; controls that can be animated have a keyframe button."""

import math

from bpy.types import Panel

from ..core import systems
from ..scene.life.settings import CONTROLS
from . import audio, performers, preferences, words
from .panel import OfFacePanel, named
from .target import sequencer_scene, target

_OTHERS = ("fps", "axes", "landmark_file")


def _is_shown(control, settings) -> bool:
    """Whether the panel shows a control.

    Controls of *Life* are never shown here, research controls only on request or once changed.
    """
    if control.name in CONTROLS:
        return False
    now, usual = control.number(getattr(settings, control.name)), control.number(control.default)
    # Blender stores float32, so equal numbers may differ slightly.
    changed = not math.isclose(now, usual, rel_tol=1e-5, abs_tol=1e-6)
    return changed or preferences.shows_research() or not words.is_research(control)


class ANYFACE_PT_performance(OfFacePanel, Panel):
    """How the face speaks."""

    bl_label = "Performance"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the source of the emotion, the controls, and the seldom needed settings."""
        layout, settings = self.layout, target(context).anyface
        layout.use_property_split, layout.use_property_decorate = True, True
        if len(systems.known()) > 1:
            layout.prop(settings, "system")
        layout.prop(settings, "emotion_source")
        if systems.by_name(settings.system).shows_performers:
            menu = named(layout, "Performer")
            menu.menu("ANYFACE_MT_performers", text=performers.name_of(settings))
        if systems.by_name(settings.system).hears_emotion:
            audio.draw_emotion_strip(layout, target(context), sequencer_scene(context))
            audio.draw_heat(layout, target(context))
        if systems.by_name(settings.system).starts_from_pose:
            layout.prop(settings, "starts_from_pose")
        column = layout.column(align=True)
        controls = [c for c in systems.by_name(settings.system).controls if _is_shown(c, settings)]
        for control in controls:
            if control.is_slider:
                row = column.row(align=True)
                row.use_property_decorate = control.is_animatable
                row.prop(settings, control.name, slider=True)
        header, body = layout.panel("anyface_more", default_closed=True)
        header.label(text="Seldom Needed")
        if body is not None:
            body.use_property_decorate = False
            others = [control.name for control in controls if not control.is_slider]
            plain = systems.plain_fields(systems.FILE, systems.NUMBER, systems.TEXT)
            obeyed = {field.name for field in systems.by_name(settings.system).fields}
            fields = [field.name for field in plain if field.name in obeyed]
            for name in (*fields, *others, *_OTHERS):
                body.prop(settings, name, slider=True)
