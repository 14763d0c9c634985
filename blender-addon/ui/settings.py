"""From the panel's properties to plain settings."""

from dataclasses import fields

from ..scene.bake import Settings


def from_object(ob) -> Settings:
    """The settings stored on `ob`."""
    stored = ob.anyface
    values = {
        item.name: getattr(stored, item.name)
        for item in fields(Settings)
        if hasattr(stored, item.name)
    }
    settings = Settings(**values)
    if stored.source == "STRIP":
        settings.sound_file = ""
    else:
        settings.strip = ""
    return settings


def target(context):
    """The character that the panel shows: the picked one, else the active mesh object."""
    picked = context.scene.anyface.character
    if picked is not None:
        return picked
    active = context.object
    return active if active is not None and active.type == "MESH" else None


def sequencer_scene(context):
    """The scene whose strips are heard: from 5.0 on a workspace may show another one."""
    return getattr(context, "sequencer_scene", None) or context.scene
