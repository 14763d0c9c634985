"""What is said in each sound: the text that *Mend* aligns, kept with the scene by sound."""

import bpy
from bpy.props import StringProperty
from bpy.types import PropertyGroup

from .target import sequencer_scene


class AnyfaceText(PropertyGroup):
    """A text; its name says which sound it belongs to."""

    text: StringProperty()


def of(ob, scene) -> str:
    """The text of the sound that a character speaks, or ""."""
    found = scene.anyface.texts.get(_key(ob, scene)) if scene is not None else None
    return found.text.strip() if found is not None else ""


def get(audio) -> str:
    """The same for the field in the panel of `Object.anyface_audio`."""
    return of(audio.id_data, sequencer_scene(bpy.context))


def put(audio, text: str) -> None:
    """Keeps the text of the sound that the character speaks now."""
    scene = sequencer_scene(bpy.context)
    if scene is None:
        return
    key, kept = _key(audio.id_data, scene), scene.anyface.texts
    found = kept.get(key) or kept.add()
    found.name, found.text = key, text


def _key(ob, scene) -> str:
    """What tells the sound of a character from others: names of strips, a file, a channel."""
    from . import audio

    source = ob.anyface.source
    if source == "STRIP":
        return audio.strip_of(ob, scene)
    if source == "FILE":
        return ob.anyface.sound_file
    names = [item.name for item in ob.anyface_audio.chosen]
    return f"channel {ob.anyface_audio.channel}" if source == "CHANNEL" else ", ".join(names)
