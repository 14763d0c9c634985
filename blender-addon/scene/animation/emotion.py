"""Emotion and controls over time: the curves of the panel's sliders, sampled in scene time."""

import numpy as np

from ...core import systems
from ...core.emotion import EMOTIONS, MAX_INTENSITY, Share, mix
from . import sliders

# The data path of the weight in one row of the mixture.
WEIGHT_PATH = "mixture[{}].weight"


def shares(settings) -> list[Share]:
    """All emotions of `settings` with their weights: `emotion` first, then the rows of `mixture`.

    `settings` are properties of an object, or plain data.
    """
    rows = [Share(row.emotion, row.weight) for row in settings.mixture]
    return [Share(settings.emotion, settings.intensity), *rows]


def emotion_keys(ob, scene, settings, start_frame: float, duration_s: float | None = None):
    """`(time_s, strengths[15])` rows from keyframes and drivers on `ob.anyface`, or one row.

    A property without a curve (`emotion`, `intensity`, `mixture`) has its value from `settings`.
    Times count from `start_frame`. The first row also holds before its time, and the last row
    after its time.
    """
    main, *others = shares(settings)
    paths = [WEIGHT_PATH.format(number) for number in range(len(others))]
    names = sliders.animated(ob, ("emotion", "intensity", *paths))
    if not names:
        return [(0.0, mix([main, *others]))]
    scene_fps = scene.render.fps / scene.render.fps_base
    at = sliders.times(ob, names, start_frame, scene_fps, duration_s)
    read = sliders.values(ob, scene, names, start_frame + at * scene_fps)
    emotions = read.get("emotion", np.full(len(at), EMOTIONS.index(main.emotion)))
    numbers = np.clip(np.round(emotions), 0, len(EMOTIONS) - 1).astype(int)
    still = zip(("intensity", *paths), (main, *others), strict=True)
    amounts = [read.get(name, np.full(len(at), share.weight)) for name, share in still]
    weights = np.clip(amounts, 0.0, MAX_INTENSITY)
    kinds = [[EMOTIONS[number], *(share.emotion for share in others)] for number in numbers]
    rows = [list(map(Share, *row)) for row in zip(kinds, weights.T.tolist(), strict=True)]
    return [(float(time_s), mix(row)) for time_s, row in zip(at, rows, strict=True)]


def control_keys(ob, scene, settings, start_frame: float, duration_s: float | None = None):
    """Times `[N]` in seconds and values `[N]` of every control with a curve or a driver.

    Controls that `settings.fixed_controls` fixes are left out.
    """
    names = [control.name for control in systems.controls() if control.is_animatable]
    names = sliders.animated(ob, [name for name in names if name not in settings.fixed_controls])
    if not names:
        return {}
    scene_fps = scene.render.fps / scene.render.fps_base
    at = sliders.times(ob, names, start_frame, scene_fps, duration_s)
    read = sliders.values(ob, scene, names, start_frame + at * scene_fps)
    limits = ob.anyface.bl_rna.properties
    clipped = {n: np.clip(read[n], limits[n].hard_min, limits[n].hard_max) for n in names}
    return {name: (at, values) for name, values in clipped.items()}
