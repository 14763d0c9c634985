"""What an output will cost."""

import math

from ...core import estimate
from .. import outputs
from ..shape_keys import artist_keys


def describe(ob, scene, seconds: float | None, settings, given: outputs.OutputSettings) -> str:
    """One line for the panel; `settings` are those of `ui.properties.AnyfaceCharacter`, `seconds`
    the length of the sound."""
    scene_fps = scene.render.fps / scene.render.fps_base
    if seconds is None:
        return "Size and time follow from the sound"
    frames = math.ceil(seconds * (settings.fps or scene_fps))
    keys = len(artist_keys.names_of(artist_keys.find(ob, given.mapping)))
    asked = estimate.Asked(frames, len(ob.data.vertices), seconds, keys, given.visemes)
    cost = outputs.of(settings.mode).cost(asked)
    return estimate.in_words(cost, asked, outputs.has_take(ob))
