"""The words of each sound, which the mouth follows; the scene stores one text for each sound."""

import bpy
from bpy.props import StringProperty
from bpy.types import PropertyGroup

from . import audio
from .target import sequencer_scene, target


class AnyfaceText(PropertyGroup):
    """A text; `name` is the key of the sound to which it belongs."""

    text: StringProperty()


def of(ob, scene) -> str:
    """The text of the sound that a character speaks, or ""."""
    if ob is None or scene is None:
        return ""
    row = scene.anyface.texts.get(_key(ob, scene))
    return row.text.strip() if row is not None else ""


def get(_settings) -> str:
    """Reads the panel's text field: the text of the sound that its character speaks."""
    return of(target(bpy.context), sequencer_scene(bpy.context))


def put(_settings, text: str) -> None:
    """Stores the text of the sound that the panel's character speaks now."""
    ob, scene = target(bpy.context), sequencer_scene(bpy.context)
    if ob is None or scene is None:
        return
    key, rows = _key(ob, scene), scene.anyface.texts
    row = rows.get(key) or rows.add()
    row.name, row.text = key, text


def _key(ob, scene) -> str:
    """The key of a character's sound: names of strips, a file, or a channel."""
    source = ob.anyface.source
    if source == "STRIP":
        return audio.strip_of(ob, scene)
    if source == "FILE":
        return ob.anyface.sound_file
    names = [item.name for item in ob.anyface_audio.chosen]
    return f"channel {ob.anyface_audio.channel}" if source == "CHANNEL" else ", ".join(names)
