"""The panel's sliders over time: keyframes, drivers and NLA strips, sampled at scene frames."""

import bpy
import numpy as np

from . import curves

# The time between samples. A face cannot show faster changes.
STEP_S = 0.1
_PREFIX = "anyface."


def animated(ob, names) -> list[str]:
    """The `names` that have a curve or a driver.

    `names` are properties of `ob.anyface` and of its rows.
    """
    return [name for name in names if is_keyed(ob, name) or needs_scene(ob, name)]


def is_keyed(ob, name: str) -> bool:
    """True if the assigned action has a curve for the property."""
    return curves.find(ob.animation_data, _PREFIX + name) is not None


def needs_scene(ob, name: str) -> bool:
    """True if a driver or an NLA strip moves the property: only Blender can evaluate these."""
    animation = ob.animation_data
    if animation is None:
        return False
    path = _PREFIX + name
    if any(driver.data_path == path for driver in animation.drivers):
        return True
    strips = [strip for track in animation.nla_tracks for strip in track.strips]
    actions = [strip.action for strip in strips if strip.action is not None]
    bags = [bag for action in actions for bag in curves.bags(action)]
    return any(curve.data_path == path for bag in bags for curve in bag.fcurves)


def times(ob, names, start_frame: float, scene_fps: float, duration_s: float | None) -> np.ndarray:
    """Seconds from `start_frame` at which to read values, `[N]`.

    They reach to the last keyframe. If a driver or an NLA strip moves a property, they also reach
    to `duration_s`, or to 60 s if that is None.
    """
    fcurves = [curves.find(ob.animation_data, _PREFIX + name) for name in names]
    last_frame = max((c.range()[1] for c in fcurves if c is not None), default=start_frame)
    last_s = max(0.0, (last_frame - start_frame) / scene_fps)
    if any(needs_scene(ob, name) for name in names):
        last_s = max(last_s, duration_s if duration_s is not None else 60.0)
    return np.arange(0.0, last_s + STEP_S, STEP_S)


def values(ob, scene, names, frames: np.ndarray) -> dict[str, np.ndarray]:
    """The values of each property at `frames` `[N]`; an enum gives the numbers of its items."""
    if any(needs_scene(ob, name) for name in names):
        return _by_stepping(ob, scene, names, frames)
    read = {}
    for name in names:
        curve = curves.find(ob.animation_data, _PREFIX + name)
        now = _number(ob.anyface, name)
        read[name] = np.array([curve.evaluate(f) if curve else now for f in frames])
    return read


def _by_stepping(ob, scene, names, frames) -> dict[str, np.ndarray]:
    """Steps through the scene frame by frame, then returns to the frame that was shown."""
    before = scene.frame_current, scene.frame_subframe
    rows = []
    try:
        for frame in frames:
            whole = int(np.floor(frame))
            scene.frame_set(whole, subframe=float(frame - whole))
            shown = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).anyface
            rows.append([_number(shown, name) for name in names])
    finally:
        scene.frame_set(before[0], subframe=before[1])
    columns = np.array(rows, dtype=np.float64).reshape(len(frames), len(names)).T
    return dict(zip(names, columns, strict=True))


def _number(settings, name: str) -> float:
    value = settings.path_resolve(name)
    if isinstance(value, str):
        return float(settings.bl_rna.properties[name].enum_items[value].value)
    return float(value)
