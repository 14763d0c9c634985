"""A take in two layers: the speech, and the emotion on top of it."""

import numpy as np

from .sliders import SliderChange
from .take import Basis

# The ends of the emotion slider.
_KNOTS = (0.0, 1.5)


def joined(said: Basis, emotion: Basis) -> Basis:
    """Joins both layers into one basis.

    It keeps the sliders of speech and blinks; a new emotion slider scales the emotion layer.
    """
    first = said.weights.shape[1]
    weights = np.concatenate([said.weights, emotion.weights], axis=1)
    more = ((0, 0), (0, 0), (0, weights.shape[1] - first))
    sliders = {
        name: SliderChange(change.knots, np.pad(change.changes, more))
        for name, change in said.sliders.items()
        if name in ("articulation", "blinks")
    }
    if emotion.weights.any():
        scaled = np.concatenate([np.zeros_like(said.weights), emotion.weights], axis=1)
        knots = np.array(_KNOTS, dtype=np.float32)
        sliders["emotion"] = SliderChange(knots, (knots - 1.0)[:, None, None] * scaled)
    vectors = np.concatenate([said.vectors, emotion.vectors])
    error_mm = said.error_mm + emotion.error_mm
    return Basis(vectors, weights, error_mm, sliders, offered=said.offered, emotion_first=first)
