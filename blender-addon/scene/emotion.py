"""Emotion over time: the curves of the panel's sliders, sampled at the scene's frames."""

import numpy as np

from ..core.emotion import EMOTIONS, strengths
from . import curves

# Two samples a tenth of a second apart follow every change that a face can follow.
_STEP_S = 0.1


def emotion_keys(ob, settings, start_frame: float, duration_s: float, scene_fps: float):
    """`(time_s, strengths[15])` from the keyframes on `ob.anyface`, or one constant entry.

    `settings` holds the values where no keyframes are (`emotion`, `intensity`).
    """
    emotion = curves.find(ob.animation_data, "anyface.emotion")
    intensity = curves.find(ob.animation_data, "anyface.intensity")
    if emotion is None and intensity is None:
        return [(0.0, strengths(settings.emotion, settings.intensity))]
    keys = []
    for time_s in np.arange(0.0, duration_s + _STEP_S, _STEP_S):
        frame = start_frame + time_s * scene_fps
        name, amount = settings.emotion, settings.intensity
        if emotion is not None:
            name = EMOTIONS[int(np.clip(round(emotion.evaluate(frame)), 0, len(EMOTIONS) - 1))]
        if intensity is not None:
            amount = float(np.clip(intensity.evaluate(frame), 0.0, 1.5))
        keys.append((float(time_s), strengths(name, amount)))
    return keys
