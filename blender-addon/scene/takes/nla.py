"""Takes as strips of the NLA.

A strip below them holds all our keys at 0. Without it, Blender would blend a strip of less than
full influence with the default value of a key, which is 1. A muted strip would leave its keys where
they were.
"""

import bpy
import numpy as np

from ..animation import curves
from ..shape_keys import record

REST = "anyface_rest"
_REST_NAME = "Anyface Rest"


def push(ob, take_record: record.Record, action) -> None:
    """Adds a track with a strip that plays `action` at the frames of its keyframes."""
    shape_keys = ob.data.shape_keys
    animation = shape_keys.animation_data
    _hold_at_rest(ob, take_record)
    first, last = action.frame_range
    strip = add_strip(animation, take_record.name, action, first)
    # The constructor takes whole frames only.
    strip.action_frame_start, strip.action_frame_end = first, last
    strip.frame_end, strip.frame_start = last, first
    strip.frame_end = last
    strip.extrapolation = "NOTHING"


def leave(shape_keys, take_record: record.Record, action) -> None:
    """Removes the strips of `action`, and the rest curves of the take's keys."""
    animation = shape_keys.animation_data
    remove_strips(animation, action)
    rest = shape_keys.get(REST)
    if rest is None:
        return
    others = [other for other in record.everyone(shape_keys) if other.in_nla]
    used = {name for other in others if other.id != take_record.id for name in other.keys}
    paths = {curves.value_path(name) for name in take_record.keys if name not in used}
    for bag in curves.bags(rest):
        for curve in [curve for curve in bag.fcurves if curve.data_path in paths]:
            bag.fcurves.remove(curve)
    if curves.is_empty(rest):
        remove_strips(animation, rest)
        del shape_keys[REST]
        curves.delete_action(rest)


def rest_channels(shape_keys):
    """The holder of the curves that keep keys at rest, or None."""
    rest = shape_keys.get(REST)
    return curves.bags(rest)[0] if rest is not None else None


def hold(bag, names: list[str]) -> None:
    """Keeps keys at 0 while no take plays them; `bag` comes from `rest_channels`."""
    for name in names:
        curves.write(bag, curves.value_path(name), np.zeros(1), np.zeros(1))


def _hold_at_rest(ob, take_record) -> None:
    if not take_record.keys:
        return
    shape_keys = ob.data.shape_keys
    rest = shape_keys.get(REST)
    fresh = rest is None
    if fresh:
        rest, _ = curves.new_action(f"{ob.name} {_REST_NAME}")
        shape_keys[REST] = rest
    hold(rest_channels(shape_keys), take_record.keys)
    if fresh:
        add_strip(shape_keys.animation_data, _REST_NAME, rest, 0.0).extrapolation = "HOLD"


def add_strip(animation, name: str, action, first: float):
    """Adds a strip of `action` on a new track, beginning at frame `first`; returns it."""
    track = animation.nla_tracks.new()
    track.name = name
    strip = track.strips.new(name, round(first), action)
    curves.assign(strip, action)
    return strip


def remove_strips(animation, action: bpy.types.Action) -> None:
    """Removes the strips of `action`, and the tracks that are then empty."""
    for track in list(animation.nla_tracks):
        for strip in [strip for strip in track.strips if strip.action == action]:
            track.strips.remove(strip)
            if len(track.strips) == 0:
                animation.nla_tracks.remove(track)
                break
