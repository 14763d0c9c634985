"""Performance: emotion, controls and presets; what can change over time has a keyframe button."""

from dataclasses import fields

from bpy.types import Panel

from ..core.sweep import ANIMATABLE
from ..core.take import Controls
from .panel import OfFacePanel
from .target import target

_MORE = ("seed", "style", "fps", "steps", "learned", "axes", "landmark_file")


class ANYFACE_PT_performance(OfFacePanel, Panel):
    """How the face speaks."""

    bl_label = "Performance"
    bl_order = 2

    def draw_header_preset(self, _context):
        """Draws the presets at the right of the header."""
        self.layout.menu("ANYFACE_MT_presets", text="", icon="PRESET")

    def draw(self, context):
        """Draws emotion, controls and what is seldom needed."""
        layout, settings = self.layout, target(context).anyface
        layout.use_property_split, layout.use_property_decorate = True, True
        column = layout.column(align=True)
        column.prop(settings, "emotion_source")
        if settings.emotion_source == "GIVEN":
            column.prop(settings, "emotion")
            column.prop(settings, "intensity", slider=True)
        column = layout.column(align=True)
        for item in fields(Controls):
            row = column.row(align=True)
            row.use_property_decorate = item.name in ANIMATABLE
            row.prop(settings, item.name, slider=True)
        header, body = layout.panel("anyface_more", default_closed=True)
        header.label(text="More")
        if body is not None:
            body.use_property_decorate = False
            for name in _MORE:
                body.prop(settings, name)


CLASSES = (ANYFACE_PT_performance,)
