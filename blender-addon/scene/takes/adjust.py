"""Changes a finished take: its strength, its sliders, and its place in time."""

from functools import lru_cache

import numpy as np

from ...core import shapes, sliders
from .. import copies, outputs
from ..animation import bezier, curves
from ..shape_keys import guard, record, slider_changes
from . import corrections, together

# Groups of named shapes that can be scaled on their own, by the prefixes of the shapes' names.
GROUPS = {
    "mouth": ("jaw", "mouth", "tongue", "viseme_"),
    "blinks": ("eyeBlink",),
    "brows": ("brow",),
}
# Weights below this are rounding errors.
_NOTHING = 1e-6
_NAMED = "it acts on New Keys; scale mouth, blinks and brows instead"
_OLDER = "the take was made by an earlier version: generate again"


def adjust(ob, **changes: float) -> None:
    """Changes the take of `ob` and of the objects beside it.

    `strength` scales all motion, and `shift` moves it by scene frames. A name of `GROUPS` scales
    the shapes of that group. A name of `sliders.NAMES` changes basis keys as a new run would,
    within the limits of the slider, unless `why_not` gives a reason against it. All values are
    relative to the take as it was made. Settings that are not named stay.
    """
    copies.settle()
    for part in (ob, *together.others_of(ob)):
        if record.is_generated(part):
            corrected = corrections.is_corrected(part)
            _adjust(part, changes)
            if not corrected:
                corrections.settle(part)


def has_take(ob) -> bool:
    """Whether `ob` has a take in its keys or as a cache."""
    return outputs.of_object(ob) is not None


def is_named(ob) -> bool:
    """Whether the take of `ob` consists of named shapes."""
    output = outputs.of_object(ob)
    return output is not None and not output.as_basis and not output.finished


def names_of(ob) -> tuple[str, ...]:
    """The names that the panel shows beside the strength: sliders, or groups of shapes."""
    if is_named(ob):
        return tuple(groups_of(record.read(ob.data.shape_keys)))
    take_record = record.read(ob.data.shape_keys) if record.is_generated(ob) else None
    still = take_record.still if take_record is not None else {}
    return tuple(name for name in sliders.NAMES if still.get(name) != sliders.NONE)


def why_not(ob, name: str) -> str:
    """Why a name of `names_of` cannot change the take of `ob`, or ""."""
    output = outputs.of_object(ob)
    if output is None:
        return "there is no take: generate one"
    if output.finished:
        return output.finished
    take_record = record.read(ob.data.shape_keys)
    if not output.as_basis:
        return "" if name in groups_of(take_record) else _NAMED
    if name in slider_changes.read(ob.data.shape_keys, take_record):
        return ""
    return take_record.still.get(name, _OLDER)


def groups_of(take_record: record.Record) -> list[str]:
    """The groups that contain shapes of a take."""
    groups = [
        _group(take_record.shown.get(name, name))
        for name in (*take_record.keys, *take_record.values)
    ]
    return [name for name in GROUPS if name in groups]


def _adjust(ob, changes: dict[str, float]) -> None:
    guard.unshare(ob)
    shape_keys = ob.data.shape_keys
    take_record = record.read(shape_keys)
    before, shift = dict(take_record.adjusted), take_record.adjusted.get("shift", 0.0)
    take_sliders, output = (
        slider_changes.read(shape_keys, take_record),
        outputs.of_record(take_record),
    )
    take_record.adjusted |= _possible(changes, output, take_sliders)
    moved = take_record.adjusted.get("shift", 0.0) - shift
    added = _added(take_sliders, before, take_record.adjusted)
    if added is not None:
        frames = take_record.first_frame + shift + take_record.frame_step * np.arange(len(added))
    bag = curves.channels(shape_keys.animation_data)
    fcurves = {curve.data_path: curve for curve in bag.fcurves} if bag is not None else {}
    if "eval_time" in fcurves:
        _change(fcurves["eval_time"], 1.0, moved)
    for number, name in enumerate(
        (*take_record.keys, *take_record.values) if not output.finished else ()
    ):
        shown = take_record.shown.get(name, name)
        now, block = factor(shown, take_record.adjusted), shape_keys.key_blocks.get(name)
        if block is None or curves.value_path(name) not in fcurves:
            continue
        more = None if added is None else (frames, now * added[:, number])
        low, high = _change(
            fcurves[curves.value_path(name)], now / factor(shown, before), moved, more
        )
        if name in take_record.keys:
            block.slider_min, block.slider_max = min(block.slider_min, low), max(1.0, high)
    record.write(shape_keys, take_record)


def _possible(changes, output, take_sliders) -> dict[str, float]:
    """The `changes` that can be applied, with sliders of basis keys clamped to their limits."""
    if not output.as_basis:
        groups = ("strength", "shift", *GROUPS)
        return {name: value for name, value in changes.items() if name in groups}
    limited = {
        name: min(max(changes[name], change.limits[0]), change.limits[1])
        for name, change in take_sliders.items()
        if name in changes and name in sliders.NAMES
    }
    return {name: changes[name] for name in ("strength", "shift") if name in changes} | limited


def _added(take_sliders, before, after) -> np.ndarray | None:
    """The weights `[T, K]` that the moved sliders add; None if no slider has moved."""
    moved = []
    for name, change in take_sliders.items():
        old, new = sliders.place(name, before), sliders.place(name, after)
        if old != new:
            moved.append(change.at(new) - change.at(old))
    return sum(moved) if moved else None


def factor(name: str, adjusted: dict[str, float]) -> float:
    """The factor by which a shape of a take was scaled."""
    return adjusted.get("strength", 1.0) * adjusted.get(_group(name), 1.0)


# A drag calls this for every key many times a second.
@lru_cache(maxsize=1024)
def _group(key: str) -> str:
    """The group of a key in any spelling of its name; empty if it is in none."""
    shape = next(iter(shapes.match([key])), "")
    return next((name for name, starts in GROUPS.items() if shape.startswith(starts)), "")


def _change(curve, factor: float, moved: float, more=None) -> tuple[float, float]:
    """Scales a curve, adds `more` to it, and moves it in time.

    `more` holds frames `[T]`, before the move, and the values to add at them. Keyframes that the
    artist has moved or added change too. Nothing is added outside the take. Returns the lowest and
    the highest value.
    """
    if bezier.is_sparse(curve):
        return bezier.change(curve, factor, moved, more)
    points = curves.places(curve)
    points[1::2] *= factor
    if more is not None:
        frames, added = more
        # Keyframes lie at rounded frames, so half a frame of the take is the tolerance.
        half = 0.5 * (frames[1] - frames[0]) if len(frames) > 1 else 0.5
        inside = (points[0::2] > frames[0] - half) & (points[0::2] < frames[-1] + half)
        points[1::2] += inside * np.interp(points[0::2], frames, added)
    # Blender skips keys whose value is exactly 0, so tiny values become 0.
    points[1::2] *= np.abs(points[1::2]) > _NOTHING
    points[0::2] += moved
    curves.put(curve, {"co": points})
    return float(points[1::2].min(initial=0.0)), float(points[1::2].max(initial=0.0))
