"""The output panel: which outputs are possible, and how large they get."""

from bpy.props import StringProperty
from bpy.types import Operator, Panel

from ..core import holding, sparse
from ..scene import outputs
from ..scene.outputs import estimate
from ..scene.shape_keys import record
from ..scene.takes import adjust
from . import audio, output_properties, running, words
from .panel import OfFacePanel
from .target import sequencer_scene, target


class ANYFACE_PT_output(OfFacePanel, Panel):
    """The output, its options, and its size."""

    bl_label = "Output"
    bl_order = 3

    def draw(self, context):
        """Draws the panel."""
        layout, ob = self.layout, target(context)
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = output_properties.read(ob)
        reason = _draw_modes(layout, ob, settings)
        outputs.of(ob.anyface.mode).draw(layout, ob)
        if outputs.of(ob.anyface.mode).has_curves:
            layout.prop(ob.anyface, "curves")
            if ob.anyface.curves == holding.HELD:
                column = layout.column(align=True)
                for name in ("pose_on", "pose_closures", "pose_vowels"):
                    column.prop(ob.anyface, name)
            if ob.anyface.curves == sparse.SPARSE:
                layout.prop(ob.anyface, "curves_mm", text="Tolerance (mm)")
        if reason:
            _draw_words(layout, reason, context.region.width, alert=True)
            return
        if adjust.has_take(ob) and not running.is_running():
            _draw_sliders(layout, ob)
        scene = sequencer_scene(context)
        text = estimate.describe(ob, scene, audio.seconds(ob, scene), ob.anyface, settings)
        _draw_words(layout, text, context.region.width)
        layout.operator("anyface.export", text="Export Talking Head…", icon="EXPORT")


def _draw_modes(layout, ob, settings) -> str:
    """Draws a button for each output, grey if it cannot work.

    Returns why the chosen output cannot work, or "".
    """
    reasons = {output.name: output.why_not(ob, settings) for output in outputs.ALL}
    column = layout.column(align=True)
    # A property split would draw the names beside empty buttons.
    column.use_property_split = False
    for mode, reason in reasons.items():
        row = column.row(align=True)
        if not reason:
            row.prop_enum(ob.anyface, "mode", mode)
            continue
        button = row.row(align=True)
        button.enabled = False
        button.prop_enum(ob.anyface, "mode", mode)
        row.operator("anyface.why_not", text="", icon="QUESTION").reason = reason
    return reasons[ob.anyface.mode]


def _draw_sliders(layout, ob) -> None:
    """Draws sliders that change the finished take; one that cannot is grey, with the reason."""
    column = layout.column(align=True)
    column.label(text="Change This Take")
    stored, in_keys = ob.anyface_output, record.is_generated(ob)
    if in_keys:
        column.prop(stored, "strength", slider=True)
    for name in adjust.names_of(ob):
        row = column.row(align=True)
        reason = adjust.why_not(ob, name)
        button = row.row(align=True)
        button.enabled = not reason
        button.prop(stored, output_properties.slider_of(ob, name), slider=True)
        if reason:
            row.operator("anyface.why_not", text="", icon="QUESTION").reason = reason
    if in_keys:
        column.prop(stored, "shift")


def _draw_words(layout, text: str, width: int, alert: bool = False) -> None:
    box = layout.box().column(align=True)
    box.alert = alert
    words.draw(box, text, width)


class ANYFACE_OT_why_not(Operator):
    """Why this output cannot work here"""

    bl_idname = "anyface.why_not"
    bl_label = "Why Unavailable?"
    bl_options = {"INTERNAL"}

    reason: StringProperty()

    @classmethod
    def description(cls, context, properties):
        return properties.reason

    def execute(self, context):
        """Shows the reason."""
        self.report({"INFO"}, f"Anyface: {self.reason}")
        return {"FINISHED"}
