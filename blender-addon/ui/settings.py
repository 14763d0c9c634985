"""From the panel's properties to plain settings."""

from dataclasses import fields

from ..scene.bake import Settings
from . import audio, character, output_properties
from .target import sequencer_scene, target

__all__ = ["from_object", "sequencer_scene", "target"]


def from_object(ob) -> Settings:
    """The settings stored on `ob`."""
    stored = ob.anyface
    values = {
        item.name: getattr(stored, item.name)
        for item in fields(Settings)
        if hasattr(stored, item.name)
    }
    settings = Settings(**values, output=output_properties.read(ob))
    if stored.source != "FILE":
        settings.sound_file = ""
    if stored.source != "STRIP":
        settings.strip = ""
    audio.fill(settings, ob)
    character.fill(settings, ob)
    return settings
