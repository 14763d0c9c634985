"""The length of the chosen sound, and what an output of it will cost."""

import math
import os
from functools import lru_cache

import bpy

from ..core import estimate
from ..core.errors import AnyfaceError
from . import existing, sequencer


def describe(ob, scene, settings, output) -> str:
    """One line for the panel; `settings` are those of `ui.properties.AnyfaceCharacter`."""
    scene_fps = scene.render.fps / scene.render.fps_base
    seconds = duration_s(scene, settings, scene_fps)
    if seconds is None:
        return "Size and time follow from the sound"
    frames = math.ceil(seconds * (settings.fps or scene_fps))
    keys = len(existing.find(ob, output.mapping)) if settings.mode == "keys" else 0
    given = (frames, len(ob.data.vertices), seconds, keys, output.visemes)
    return estimate.in_words(estimate.estimate(settings.mode, *given), frames)


def duration_s(scene, settings, scene_fps: float) -> float | None:
    """Seconds of the chosen sound; None where it cannot be told without decoding it."""
    if settings.source == "STRIP":
        try:
            strip = sequencer.sound_strip(scene, settings.strip)
        except AnyfaceError:
            return None
        return strip.frame_final_duration / scene_fps
    path = bpy.path.abspath(settings.sound_file)
    if not settings.sound_file or not os.path.isfile(path):
        return None
    return _file_s(path, os.path.getmtime(path))


@lru_cache(maxsize=16)
def _file_s(path: str, _changed: float) -> float | None:
    try:
        import aud

        sound = aud.Sound(path)
        return sound.length / sound.specs[0]
    except Exception:
        # Without `aud` (some builds of bpy) or for a file that it cannot read: no estimate.
        return None
