"""From the panel's properties to plain settings."""

from dataclasses import fields

from ..core import holding, systems
from ..scene import copies, outputs
from ..scene.animation import emotion
from ..scene.bake import Settings
from ..scene.shape_keys import artist_keys
from . import audio, character, life, output_properties

# A face with this many keys of known names was built to speak.
_MANY_KEYS = 10


def from_object(ob, scene=None) -> Settings:
    """The settings stored on `ob`.

    If no strip was chosen, it speaks the only strip of `scene`.
    """
    copies.settle()
    _start_with_keys(ob)
    stored = ob.anyface
    values = {
        item.name: getattr(stored, item.name)
        for item in fields(Settings)
        if hasattr(stored, item.name)
    }
    values["controls"] = {
        control.name: control.number(getattr(stored, control.name))
        for control in systems.controls()
    }
    # Emotion and intensity have fields of their own.
    values["mixture"] = emotion.shares(stored)[1:]
    settings = Settings(**values, output=output_properties.read(ob))
    settings.holds = holding.Holds(stored.pose_on, stored.pose_closures, stored.pose_vowels)
    audio.fill(settings, ob, scene)
    character.fill(settings, ob)
    settings.life = life.read(ob)
    return settings


def _start_with_keys(ob) -> None:
    """Lets a face that has many keys of known names use these, until the artist chooses."""
    if ob.library is not None or ob.type != "MESH" or ob.anyface.is_property_set("mode"):
        return
    if len(artist_keys.names_of(artist_keys.find(ob, []))) >= _MANY_KEYS:
        ob.anyface.mode = outputs.Keys.name
