"""Anyface for Blender: makes any face mesh talk.

Flow of one take: `scene.bake.read` (mesh, sound, emotion) → `core.perform` with the native
library (no bpy, any thread) → `scene.bake.write` (shape keys and their curves).
"""

import bpy

from .ui import (
    audio,
    character,
    command,
    generate,
    landmarks,
    panel,
    performance,
    preferences,
    presets,
    properties,
    remove,
    running,
)

_CLASSES = (
    *preferences.CLASSES,
    *generate.CLASSES,
    *remove.CLASSES,
    *panel.CLASSES,
    *character.CLASSES,
    *landmarks.CLASSES,
    *audio.CLASSES,
    *presets.CLASSES,
    *performance.CLASSES,
)


def register():
    """Blender enables the add-on."""
    properties.register()
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    landmarks.register()
    command.register()
    running.register()


def unregister():
    """Blender disables the add-on; a running job is cancelled first."""
    running.unregister()
    command.unregister()
    landmarks.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    properties.unregister()
