"""Estimates the size and the time of an output."""

import math

from ...core import estimate
from .. import outputs
from ..shape_keys import artist_keys


def describe(
    ob, scene, seconds: float | None, settings, output_settings: outputs.OutputSettings
) -> str:
    """One line for the panel.

    `settings` are those of `ui.properties.AnyfaceCharacter`, `seconds` is the length of the sound.
    """
    scene_fps = scene.render.fps / scene.render.fps_base
    if seconds is None:
        return "Size and time follow from the sound"
    frames = math.ceil(seconds * (settings.fps or scene_fps))
    keys = len(artist_keys.names_of(artist_keys.find(ob, output_settings.mapping)))
    workload = estimate.Asked(frames, len(ob.data.vertices), seconds, keys, output_settings.visemes)
    cost = outputs.of(settings.mode).cost(workload)
    return estimate.in_words(cost, workload, outputs.has_take(ob))
