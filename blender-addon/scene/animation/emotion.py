"""Emotion and controls over time: the curves of the panel's sliders, sampled in scene time."""

import numpy as np

from ...core import systems
from ...core.emotion import EMOTIONS, MAX_INTENSITY, strengths
from . import sliders


def emotion_keys(ob, scene, settings, start_frame: float, duration_s: float | None = None):
    """`(time_s, strengths[15])` rows from keyframes and drivers on `ob.anyface`, or one row.

    `settings` holds the values where no curves are (`emotion`, `intensity`). Times count from
    `start_frame`; before the first and after the last row the values hold.
    """
    names = sliders.animated(ob, ("emotion", "intensity"))
    if not names:
        return [(0.0, strengths(settings.emotion, settings.intensity))]
    scene_fps = scene.render.fps / scene.render.fps_base
    at = sliders.times(ob, names, start_frame, scene_fps, duration_s)
    read = sliders.values(ob, scene, names, start_frame + at * scene_fps)
    chosen = EMOTIONS.index(settings.emotion)
    emotions = read.get("emotion", np.full(len(at), chosen))
    amounts = read.get("intensity", np.full(len(at), settings.intensity))
    keys = []
    for time_s, number, amount in zip(at, emotions, amounts, strict=True):
        name = EMOTIONS[int(np.clip(round(number), 0, len(EMOTIONS) - 1))]
        keys.append((float(time_s), strengths(name, float(np.clip(amount, 0.0, MAX_INTENSITY)))))
    return keys


def control_keys(ob, scene, settings, start_frame: float, duration_s: float | None = None):
    """Times `[N]` in seconds and values `[N]` of every control that has a curve or a driver, those
    that `settings` hold left out."""
    names = [control.name for control in systems.controls() if control.is_animatable]
    names = sliders.animated(ob, [name for name in names if name not in settings.held])
    if not names:
        return {}
    scene_fps = scene.render.fps / scene.render.fps_base
    at = sliders.times(ob, names, start_frame, scene_fps, duration_s)
    read = sliders.values(ob, scene, names, start_frame + at * scene_fps)
    limits = ob.anyface.bl_rna.properties
    clipped = {n: np.clip(read[n], limits[n].hard_min, limits[n].hard_max) for n in names}
    return {name: (at, values) for name, values in clipped.items()}
