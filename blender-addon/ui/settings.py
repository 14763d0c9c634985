"""Turns the panel's properties into plain settings."""

from dataclasses import fields

from ..core import holding, systems
from ..scene import copies, outputs
from ..scene.animation import emotion
from ..scene.bake import Settings
from ..scene.shape_keys import artist_keys
from . import audio, character, life, output_properties, texts

# A face with this many keys of known names was built to speak.
_MANY_KEYS = 10


def from_object(ob, scene=None) -> Settings:
    """The settings stored on `ob`.

    If no strip was chosen and `scene` has only one, `ob` speaks that one.
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
    values["fields"] = {
        field.name: getattr(audio.group_of(ob, field), field.name)
        for field in systems.plain_fields()
    }
    # The first share is left out: emotion and intensity have fields of their own.
    values["mixture"] = emotion.shares(stored)[1:]
    settings = Settings(**values, output=output_properties.read(ob))
    settings.holds = holding.Holds(stored.pose_on, stored.pose_closures, stored.pose_vowels)
    audio.fill(settings, ob, scene)
    settings.text = texts.of(ob, scene)
    character.fill(settings, ob)
    settings.life = life.read(ob)
    return settings


def _start_with_keys(ob) -> None:
    """Lets a face animate its own keys if many have known names and no output was chosen."""
    if ob.library is not None or ob.type != "MESH" or ob.anyface.is_property_set("mode"):
        return
    if len(artist_keys.names_of(artist_keys.find(ob, []))) >= _MANY_KEYS:
        ob.anyface.mode = outputs.Keys.name
