"""Emotion over time: the curves of the panel's sliders, sampled at the scene's frames."""

import numpy as np

from ..core.emotion import EMOTIONS, MAX_INTENSITY, strengths
from . import curves

# Samples a tenth of a second apart follow every change that a face can follow.
_STEP_S = 0.1


def emotion_keys(ob, settings, start_frame: float, scene_fps: float):
    """`(time_s, strengths[15])` from the keyframes on `ob.anyface`, or one constant entry.

    `settings` holds the values where no keyframes are (`emotion`, `intensity`). Times count from
    `start_frame`; before the first and after the last keyframe the values hold.
    """
    emotion = curves.find(ob.animation_data, "anyface.emotion")
    intensity = curves.find(ob.animation_data, "anyface.intensity")
    keyed = [curve for curve in (emotion, intensity) if curve is not None]
    if not keyed:
        return [(0.0, strengths(settings.emotion, settings.intensity))]
    last_frame = max(curve.range()[1] for curve in keyed)
    last_s = max(0.0, (last_frame - start_frame) / scene_fps)
    keys = []
    for time_s in np.arange(0.0, last_s + _STEP_S, _STEP_S):
        frame = start_frame + time_s * scene_fps
        name, amount = settings.emotion, settings.intensity
        if emotion is not None:
            name = EMOTIONS[int(np.clip(round(emotion.evaluate(frame)), 0, len(EMOTIONS) - 1))]
        if intensity is not None:
            amount = float(np.clip(intensity.evaluate(frame), 0.0, MAX_INTENSITY))
        keys.append((float(time_s), strengths(name, amount)))
    return keys
