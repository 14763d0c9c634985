"""Audio: the choice of a strip, a file, a channel, or several strips as one take."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    FloatProperty,
    IntProperty,
    StringProperty,
)
from bpy.types import Operator, PropertyGroup

from ..core import systems
from ..core.errors import AnyfaceError
from ..scene import bake
from ..scene.face import emotion_mask
from ..scene.sound import sequencer, strips
from . import words
from .operators import Acting, Alone
from .target import sequencer_scene, target


class AnyfaceStrip(PropertyGroup):
    """A chosen strip, by its name."""


class AnyfaceAudio(PropertyGroup):
    """`Object.anyface_audio`: the strips that speak together, and settings of voice and events.

    When the extension registers, it adds a property for each recording that a system can use.
    """

    channel: IntProperty(
        name="Channel",
        description="All sound strips in this channel of the sequencer become one take",
        default=1,
        min=1,
        max=128,
        options=set(),
    )
    chosen: CollectionProperty(type=AnyfaceStrip)
    emotion_strip: StringProperty(
        name="Emotion Of",
        description="Sound strip that sets the emotion of this face, stretched to the length of "
        "the spoken sound; empty uses the spoken voice itself",
        options=set(),
    )
    event_channel: IntProperty(
        name="Channel",
        description="Channel of the sequencer with text strips that say what this face does "
        "besides speaking; 0 uses none",
        default=0,
        min=0,
        max=128,
        options=set(),
    )
    event_markers: BoolProperty(
        name="Markers Too",
        description="The scene's markers are events as well. A marker's name says what the face "
        "does, such as smile, or smile:0.5 for half of it, until a marker named end or end smile",
        default=False,
        options=set(),
    )
    marker_s: FloatProperty(
        name="Marker Length",
        description="How long an event lasts after its marker if no other marker ends it",
        default=0.8,
        min=0.04,
        soft_max=4.0,
        max=600.0,
        unit="TIME_ABSOLUTE",
        options=set(),
    )


def fill(settings, ob, scene=None) -> None:
    """Copies the chosen sound of `ob` into plain settings; `scene` is the one with the strips."""
    names = "event_channel", "event_markers", "marker_s", "emotion_strip"
    for name in names:
        setattr(settings, name, getattr(ob.anyface_audio, name))
    source = ob.anyface.source
    settings.strip = strip_of(ob, scene) if source == "STRIP" else ""
    settings.sound_file = ob.anyface.sound_file if source == "FILE" else ""
    settings.channel = ob.anyface_audio.channel if source == "CHANNEL" else 0
    settings.strips = [item.name for item in ob.anyface_audio.chosen] if source == "CHOSEN" else []


def strip_of(ob, scene) -> str:
    """The chosen strip, or else the only sound strip in `scene`; "" if there is neither."""
    sound_strips = (
        sequencer.sound_strips(scene) if scene is not None and not ob.anyface.strip else []
    )
    return sound_strips[0].name if len(sound_strips) == 1 else ob.anyface.strip


class WithSound(Alone):
    """The base of operators that need the sound that the character speaks."""

    # A linked face cannot get a sound. If this is True, the button says so when it is pressed.
    accepts_linked = False

    @classmethod
    def why_not(cls, context):
        reason, ob = super().why_not(context), target(context)
        if reason or (cls.accepts_linked and ob.library is not None):
            return reason
        return why_not(ob, sequencer_scene(context))


class ANYFACE_OT_use_selected_strips(Acting, Operator):
    """Let the sound strips that are selected in the sequencer speak as one take"""

    bl_idname = "anyface.use_selected_strips"
    bl_label = "Use Selected Strips"

    def act(self, ob):
        """Stores the names of the selected strips."""
        sound_strips = sequencer.sound_strips(sequencer_scene(bpy.context))
        names = [strip.name for strip in sound_strips if strip.select]
        if not names:
            raise AnyfaceError("input", "select sound strips in the video sequencer first")
        ob.anyface_audio.chosen.clear()
        for name in names:
            ob.anyface_audio.chosen.add().name = name
        ob.anyface.source = "CHOSEN"


def draw(layout, ob, scene, width: int) -> None:
    """Draws the source of the sound, the choice within it, and its length."""
    layout.prop(ob.anyface, "source")
    if ob.anyface.source == "FILE":
        layout.prop(ob.anyface, "sound_file")
        if ob.anyface.sound_file:
            layout.prop(ob.anyface, "start_frame")
    elif scene.sequence_editor is None or not sequencer.sound_strips(scene):
        layout.operator("anyface.choose_sound", text="Choose a Sound File…", icon="FILE_SOUND")
        text = "It becomes a strip of the sequencer at the current frame"
        words.draw(layout.column(align=True), text, width, "INFO")
        return
    else:
        _draw_strips(layout, ob, scene)
    for text, icon in lines(ob, scene):
        words.draw(layout.column(align=True), text, width, icon)
    layout.prop(bpy.context.scene.anyface, "text")


def draw_emotion_strip(layout, ob, scene) -> None:
    """Draws the choice of the strip that gives the emotion, if there is a sequencer."""
    if scene is not None and scene.sequence_editor is not None:
        search_strip(layout, ob.anyface_audio, "emotion_strip", scene.sequence_editor)


def group_of(ob, field: systems.Field):
    """The properties of `ob` among which the value of a plain field is stored."""
    return ob.anyface_audio if field.kind == systems.SOUND else ob.anyface


def draw_recordings(layout, ob) -> None:
    """Draws the recordings beside the speech, greyed out unless emotion is heard in the voice."""
    column = layout.column(align=True)
    column.active = bake.hears_emotion(ob.anyface)
    for field in systems.plain_fields(systems.SOUND):
        column.label(text=field.label)
        column.prop(ob.anyface_audio, field.name, text="")


def draw_heat(layout, ob) -> None:
    """Draws the buttons of the heat map."""
    row = layout.row(align=True)
    row.operator("anyface.heat_map", icon="COLOR")
    if emotion_mask.shows_heat(ob):
        row.operator("anyface.heat_map_hide", text="", icon="X")


def search_strip(layout, group, name: str, editor, **shown) -> None:
    """Draws a choice among the strips of a sequencer, or a text field without a sequencer."""
    if editor is None:
        layout.prop(group, name, **shown)
        return
    collection = "strips_all" if hasattr(editor, "strips_all") else "sequences_all"
    layout.prop_search(group, name, editor, collection, icon="SOUND", **shown)


def _draw_strips(column, ob, scene) -> None:
    if ob.anyface.source == "STRIP":
        row = column.row(align=True)
        search_strip(row, ob.anyface, "strip", scene.sequence_editor)
        row.operator("anyface.choose_sound", text="", icon="FILE_SOUND")
    elif ob.anyface.source == "CHANNEL":
        column.prop(ob.anyface_audio, "channel")
    else:
        column.operator("anyface.use_selected_strips")


def why_not(ob, scene) -> str:
    """Why there is no sound, in words; empty if there is one."""
    source = ob.anyface.source
    if source == "FILE":
        chosen = bool(ob.anyface.sound_file)
    elif source == "STRIP":
        chosen = bool(strip_of(ob, scene))
    else:
        chosen = source == "CHANNEL" or len(ob.anyface_audio.chosen) > 0
    return "" if chosen else bake.NO_SOUND


def lines(ob, scene) -> list[tuple[str, str]]:
    """The lines about the chosen sound, each with its icon."""
    if ob.anyface.source == "FILE":
        length = strips.length_of_file(scene, ob.anyface.sound_file, ob.anyface.start_frame)
        return [(str(length), "SOUND")] if length is not None else []
    try:
        sound_strips = _strips(ob, scene)
    except AnyfaceError as error:
        return [(str(error), "ERROR")]
    if not sound_strips:
        return []
    # A single strip is used even if it is muted, since the artist has picked it.
    single = ob.anyface.source == "STRIP"
    muted = [] if single else [strip.name for strip in sound_strips if strip.mute]
    length = strips.length_of(scene, sound_strips, with_muted=single)
    only = f"{sound_strips[0].name}, " if single and not ob.anyface.strip else ""
    said = [] if length is None else [(f"{only}{_count(sound_strips)}{length}", "SOUND")]
    return said + [(f"Muted, left out: {name}", "MUTE_IPO_ON") for name in muted]


def _strips(ob, scene) -> list:
    if ob.anyface.source == "STRIP":
        name = strip_of(ob, scene)
        return [sequencer.sound_strip(scene, name)] if name else []
    names = [item.name for item in ob.anyface_audio.chosen]
    if ob.anyface.source == "CHOSEN":
        return strips.chosen(scene, names, 0) if names else []
    return strips.chosen(scene, [], ob.anyface_audio.channel)


def seconds(ob, scene) -> float | None:
    """The length of the chosen sound in seconds; None if only decoding can tell."""
    if ob.anyface.source == "FILE":
        return strips.seconds_of(ob.anyface.sound_file)
    try:
        length = strips.length_of(scene, _strips(ob, scene), ob.anyface.source == "STRIP")
    except AnyfaceError:
        return None
    return None if length is None else length.seconds


def first_frame(ob, scene) -> float | None:
    """The frame at which the chosen strips begin; None without strips."""
    try:
        length = strips.length_of(scene, _strips(ob, scene), ob.anyface.source == "STRIP")
    except AnyfaceError:
        return None
    return None if length is None else length.first


def _count(sound_strips: list) -> str:
    return "" if len(sound_strips) == 1 else f"{len(sound_strips)} strips, "


GROUPS = (AnyfaceStrip, AnyfaceAudio)
