"""Events: what the face does besides speaking, as text strips on a channel and as markers."""

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty
from bpy.types import Operator, Panel

from ..core import systems
from ..core.errors import AnyfaceError
from ..core.events import described, expression, menu
from ..scene import event_strips
from ..scene.sound import sequencer
from . import audio, preferences, words
from .operators import Acting
from .panel import OfFacePanel
from .target import sequencer_scene, target

# The most rows that are drawn. The others are only counted.
_MAX_ROWS = 12
_UNITS = "UNITS"
_EXPRESSIONS = [
    (word, word.title(), f"Units {', '.join(expression(word).units)}", number)
    for number, word in enumerate(menu())
]
_EXPRESSIONS.append((_UNITS, "Units…", "Action units of your own, such as 12,6L", len(menu())))
_SIDES = [
    ("AS_IS", "As It Is", "Both sides, or the one that the expression says", 0),
    ("LEFT", "Left", "The face's own left", 1),
    ("RIGHT", "Right", "The face's own right", 2),
]


class ANYFACE_PT_events(OfFacePanel, Panel):
    """The events of the character, for systems that show them."""

    bl_label = "Events"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """False if the chosen system shows no events."""
        if not super().poll(context):
            return False
        return systems.by_name(getattr(target(context).anyface, "system", "")).takes_events

    def draw(self, context):
        """Draws the channel, the events with their units, and the button that adds one."""
        layout, ob, scene = self.layout, target(context), sequencer_scene(context)
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(ob.anyface_audio, "event_channel")
        layout.operator_menu_enum(
            "anyface.event_add", "expression", text="Add at Playhead", icon="ADD"
        )
        layout.prop(ob.anyface_audio, "event_markers")
        if ob.anyface_audio.event_markers:
            layout.prop(ob.anyface_audio, "marker_s")
        column = layout.column(align=True)
        models = preferences.model_folder(scene)
        event_rows = event_strips.rows(scene, ob, ob.anyface_audio, _when(ob, scene), models)
        for row in event_rows[:_MAX_ROWS]:
            _draw_row(column, row, context.region.width)
        if len(event_rows) > _MAX_ROWS:
            column.label(text=f"and {len(event_rows) - _MAX_ROWS} more")
        if not event_rows:
            text = "A text strip in this channel is an event: its text says what the face does"
            words.draw(column, text, context.region.width, "INFO")


def _draw_row(column, row, width: int) -> None:
    icon = "ERROR" if row.wrong else "CHECKMARK" if row.strip is not None else "MARKER_HLT"
    said = row.wrong or described(row.expression.units, systems.units())
    text = f"{row.first}-{row.last - 1} {row.expression.said or row.name}: {said}"
    words.draw(column, text, width, icon)


def _when(ob, scene):
    """The first frame of the character's sound and its length in seconds; None without sound."""
    if ob.anyface.source == "FILE":
        return ob.anyface.start_frame, audio.seconds(ob, scene)
    first = audio.first_frame(ob, scene)
    return None if first is None else (first, audio.seconds(ob, scene))


class ANYFACE_OT_event_add(Acting, Operator):
    """Add an action of the face at the current frame, as a text strip that you can move, trim, \
copy and rename"""

    bl_idname = "anyface.event_add"
    bl_label = "Add Event"

    expression: EnumProperty(name="Expression", items=_EXPRESSIONS)
    units: StringProperty(
        name="Units", description="Action units such as 12,6L, or words", default="12"
    )
    side: EnumProperty(name="Side", items=_SIDES, default="AS_IS")
    strength: FloatProperty(name="Strength", default=1.0, min=0.0, max=1.0, subtype="FACTOR")

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        if reason or systems.by_name(getattr(target(context).anyface, "system", "")).takes_events:
            return reason
        able = [system.label for system in systems.known() if system.takes_events]
        return f"Choose a system that shows events: {', '.join(able) or 'none'}"

    def invoke(self, context, event):
        """Asks for units if the artist has chosen *Units…*."""
        if self.expression == _UNITS:
            return context.window_manager.invoke_props_dialog(self)
        return self.execute(context)

    def draw(self, _context):
        """Draws the fields for an event that consists of action units."""
        layout = self.layout
        layout.use_property_split = True
        for name in ("units", "side", "strength"):
            layout.prop(self, name)

    def act(self, ob):
        """Adds the strip, on the first free channel if none is chosen."""
        scene = sequencer_scene(bpy.context)
        if ob.library is not None:
            raise AnyfaceError("mesh", f"{ob.name} is linked and keeps no settings: make it local")
        text = self._text()
        channel = ob.anyface_audio.event_channel or event_strips.free_channel(scene)
        frame = scene.frame_current
        if not event_strips.is_free(scene, channel, frame):
            raise AnyfaceError(
                "input", f"frame {frame} of channel {channel} has a strip: move the playhead"
            )
        was_used = scene.render.use_sequencer
        strip = event_strips.add(scene, ob, channel, text, frame, self.strength)
        ob.anyface_audio.event_channel = strip.channel
        first, last = sequencer.ends(strip)
        added = f"{text} in channel {strip.channel}, frames {first} to {last - 1}"
        return sequencer.with_camera_kept(scene, was_used, added)

    def _text(self) -> str:
        """The text of the strip; raises `AnyfaceError("input")` for invalid units."""
        side = {"AS_IS": "", "LEFT": "left ", "RIGHT": "right "}[self.side]
        if self.expression != _UNITS:
            return f"{side}{self.expression}"
        meaning = expression(f"{side}{self.units}")
        if meaning.hint:
            raise AnyfaceError("input", meaning.hint)
        if not side:
            return self.units.strip()
        return ",".join(meaning.units) + ("!" if meaning.over_speech else "")
