"""Anyface for Blender: makes any face mesh talk.

Flow of one take: `scene.bake.read` (mesh, sound, emotion) → `core.perform` with the native
library (no bpy, any thread) → `scene.bake.write` (shape keys and their curves).
"""

import bpy
from bpy.types import AddonPreferences, Menu, Operator, Panel, UIList

from . import command
from .scene import copies, stale, usd
from .scene import live as following
from .scene.gltf import after_export as glTF2_post_export_callback  # noqa: F401 - glTF's exporter
from .scene.gltf import before_export as glTF2_pre_export_callback  # noqa: F401 - calls them
from .ui import (
    audio,
    caches,
    character,
    choose_sound,
    controls,
    emotion_plot,
    emotions,
    events,
    export,
    expression_keys,
    find_controls,
    generate,
    heat,
    key_list,
    landmarks,
    life,
    listening,
    live,
    made_head,
    mending,
    mixture,
    models,
    mouth_chart,
    opening,
    outputs,
    panel,
    performance,
    performers,
    pictures,
    preferences,
    presets,
    properties,
    remove,
    running,
    sample_head,
    scene_list,
    sounds,
    sounds_file,
    takes,
)

_MODULES = (
    preferences, generate, remove, mending, made_head, sample_head, panel, character,
    expression_keys, landmarks, opening, audio, choose_sound, presets, mixture, emotions,
    performance, events, life, outputs, export,
    key_list, controls, find_controls, caches, takes, performers, sounds, sounds_file, mouth_chart,
    scene_list, models, heat, live, listening,
)  # fmt: skip
_KINDS = (AddonPreferences, Menu, Operator, Panel, UIList)
# Modules with a `register` of their own: _SETTINGS go before the classes, _OTHERS after them.
_SETTINGS = (pictures, emotion_plot, properties, scene_list)
_OTHERS = (landmarks, panel, sample_head, command, running, copies, following, usd, stale)
# In the order in which they are registered.
_CLASSES = [
    cls
    for module in _MODULES
    for cls in vars(module).values()
    if isinstance(cls, type) and issubclass(cls, _KINDS) and cls.__module__ == module.__name__
]


def register():
    """Blender enables the add-on."""
    for module in _SETTINGS:
        module.register()
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for module in _OTHERS:
        module.register()


def unregister():
    """Blender disables the add-on; a running job is cancelled first."""
    for module in reversed(_OTHERS):
        module.unregister()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    for module in reversed(_SETTINGS):
        module.unregister()
