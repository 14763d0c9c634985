"""From the panel's properties to plain settings."""

from dataclasses import fields

from ..core import systems
from ..scene import copies
from ..scene.bake import Settings
from . import audio, character, life, output_properties


def from_object(ob, scene=None) -> Settings:
    """The settings stored on `ob`; the only strip of `scene` speaks where none was chosen."""
    copies.settle()
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
    settings = Settings(**values, output=output_properties.read(ob))
    audio.fill(settings, ob, scene)
    character.fill(settings, ob)
    settings.life = life.read(ob)
    return settings
