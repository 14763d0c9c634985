"""Changes a take that is there already: how strongly it moves, and when."""

import numpy as np

from . import curves, record, together
from .paths import value_path


def adjust(ob, strength: float, shift: float) -> None:
    """Scales the take of `ob` and of the objects beside it to `strength`, moves it by `shift`.

    Both count from the take as it was made; `shift` is in scene frames. Calls may follow each
    other in any order, nothing adds up.
    """
    for part in (ob, *together.others_of(ob)):
        _adjust_keys(part, strength, shift)


def _adjust_keys(ob, strength: float, shift: float) -> None:
    if not record.is_generated(ob):
        return
    shape_keys = ob.data.shape_keys
    taken = record.read(shape_keys)
    if taken.mode == "frames":
        strength = taken.strength
    paths = {value_path(name) for name in (*taken.keys, *taken.values)} | {"eval_time"}
    bag = curves.channels(shape_keys.animation_data)
    factor, moved = strength / taken.strength, shift - taken.shift
    for curve in bag.fcurves if bag is not None else ():
        if curve.data_path in paths:
            _scale(curve, factor, moved)
    for name in taken.keys if taken.mode != "frames" else ():
        block = shape_keys.key_blocks.get(name)
        if block is not None:
            block.slider_max = max(1.0, strength)
            block.slider_min = min(block.slider_min, -strength if block.slider_min < 0 else 0.0)
    taken.strength, taken.shift = strength, shift
    record.write(shape_keys, taken)


def _scale(curve, factor: float, moved: float) -> None:
    points = np.empty(len(curve.keyframe_points) * 2, dtype=np.float32)
    curve.keyframe_points.foreach_get("co", points)
    points[0::2] += moved
    points[1::2] *= factor
    curve.keyframe_points.foreach_set("co", points)
    curve.update()
