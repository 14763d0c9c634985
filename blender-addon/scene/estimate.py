"""What an output will cost."""

import math

from ..core import estimate
from . import cache, csv_file, existing, record


def describe(ob, scene, seconds: float | None, settings, output) -> str:
    """One line for the panel; `settings` are those of `ui.properties.AnyfaceCharacter`, `seconds`
    the length of the sound."""
    scene_fps = scene.render.fps / scene.render.fps_base
    if seconds is None:
        return "Size and time follow from the sound"
    frames = math.ceil(seconds * (settings.fps or scene_fps))
    keys = len(existing.find(ob, output.mapping)) if settings.mode == "keys" else 0
    known = record.is_generated(ob) or bool(cache.find(ob) or csv_file.find(ob))
    given = (frames, len(ob.data.vertices), seconds, keys, output.visemes, known)
    return estimate.in_words(estimate.estimate(settings.mode, *given), frames)
