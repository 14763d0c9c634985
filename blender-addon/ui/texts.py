"""What is said in each sound: the text that *Mend* aligns, kept with the scene by sound."""

import bpy
from bpy.props import StringProperty
from bpy.types import PropertyGroup

from . import audio
from .target import sequencer_scene, target


class AnyfaceText(PropertyGroup):
    """A text; its name says which sound it belongs to."""

    text: StringProperty()


def of(ob, scene) -> str:
    """The text of the sound that a character speaks, or ""."""
    if ob is None or scene is None:
        return ""
    row = scene.anyface.texts.get(_key(ob, scene))
    return row.text.strip() if row is not None else ""


def get(_settings) -> str:
    """The same of the character that the panel shows, for the field there."""
    return of(target(bpy.context), sequencer_scene(bpy.context))


def put(_settings, text: str) -> None:
    """Keeps the text of the sound that this character speaks now."""
    ob, scene = target(bpy.context), sequencer_scene(bpy.context)
    if ob is None or scene is None:
        return
    key, rows = _key(ob, scene), scene.anyface.texts
    row = rows.get(key) or rows.add()
    row.name, row.text = key, text


def _key(ob, scene) -> str:
    """What tells the sound of a character from others: names of strips, a file, a channel."""
    source = ob.anyface.source
    if source == "STRIP":
        return audio.strip_of(ob, scene)
    if source == "FILE":
        return ob.anyface.sound_file
    names = [item.name for item in ob.anyface_audio.chosen]
    return f"channel {ob.anyface_audio.channel}" if source == "CHANNEL" else ", ".join(names)
