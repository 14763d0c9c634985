"""Changes a take that is there already: how strongly it moves, and when."""

import numpy as np

from ..core import shapes
from . import curves, record, together
from .paths import value_path

# What a take of named shapes can change on its own: beginnings of the shapes' names.
GROUPS = {
    "mouth": ("jaw", "mouth", "tongue", "viseme_"),
    "blinks": ("eyeBlink",),
    "brows": ("brow",),
}


def adjust(ob, **wanted: float) -> None:
    """Changes the take of `ob` and of the objects beside it.

    `strength` scales all of it, a name of `GROUPS` those shapes, `shift` moves it by scene frames.
    All count from the take as it was made; what is not named stays.
    """
    for part in (ob, *together.others_of(ob)):
        if record.is_generated(part):
            _adjust(part, wanted)


def groups_of(taken: record.Record) -> list[str]:
    """The groups that a take has shapes of."""
    found = [_group(name) for name in (*taken.keys, *taken.values)]
    return [name for name in GROUPS if name in found]


def _adjust(ob, wanted: dict[str, float]) -> None:
    shape_keys = ob.data.shape_keys
    taken = record.read(shape_keys)
    before, shift = dict(taken.adjusted), taken.adjusted.get("shift", 0.0)
    taken.adjusted |= wanted
    moved = taken.adjusted.get("shift", 0.0) - shift
    bag = curves.channels(shape_keys.animation_data)
    found = {curve.data_path: curve for curve in bag.fcurves} if bag is not None else {}
    if "eval_time" in found:
        _scale(found["eval_time"], 1.0, moved)
    for name in (*taken.keys, *taken.values) if taken.mode != "frames" else ():
        factor, block = _factor(name, taken.adjusted), shape_keys.key_blocks.get(name)
        if block is None or value_path(name) not in found:
            continue
        if name in taken.keys:
            block.slider_max = max(1.0, factor)
        _scale(found[value_path(name)], factor / _factor(name, before), moved)
    record.write(shape_keys, taken)


def _factor(name: str, adjusted: dict[str, float]) -> float:
    return adjusted.get("strength", 1.0) * adjusted.get(_group(name), 1.0)


def _group(key: str) -> str:
    """The group of a key, whatever its spelling; empty for none."""
    shape = next(iter(shapes.match([key])), "")
    return next((name for name, starts in GROUPS.items() if shape.startswith(starts)), "")


def _scale(curve, factor: float, moved: float) -> None:
    points = np.empty(len(curve.keyframe_points) * 2, dtype=np.float32)
    curve.keyframe_points.foreach_get("co", points)
    points[0::2] += moved
    points[1::2] *= factor
    curve.keyframe_points.foreach_set("co", points)
    curve.update()
