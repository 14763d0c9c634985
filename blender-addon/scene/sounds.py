"""What is heard as text strips above the sound, which the artist may move, rename, delete and add.

A strip keeps the exact times of what it shows, in seconds from the begin of the sound, beside the
frames at which it was put: while it stays there these times hold, else its frames do. All are
muted: Blender would render them over the picture.
"""

import bpy
import numpy as np

from . import sequencer

# What a strip belongs to: the name of its sound. Copies of a strip bring it along.
_SOUND = "anyface_sound"
_SECONDS, _FRAMES = "anyface_seconds", "anyface_frames"
LABEL = "MBP"


def show(scene, source, closures: np.ndarray) -> int:
    """Puts a strip for each interval `[N, 2]`, seconds, of the sound `source`; earlier ones go.

    Returns their number.
    """
    clear(scene, source.name)
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    channel = 1 + max((strip.channel for strip in sequencer.all_strips(scene)), default=0)
    fps, free = scene.render.fps / scene.render.fps_base, -np.inf
    for start_s, end_s in closures:
        first, last = (round(source.start_frame + at * fps) for at in (start_s, end_s))
        first = int(max(first, free))
        free = last = max(last, first + 1)
        strip = _new(strips, channel, first, last)
        strip.text, strip.mute = LABEL, True
        start = round(source.start_frame)
        strip[_SOUND], strip[_SECONDS] = source.name, [float(start_s), float(end_s)]
        strip[_FRAMES] = [first - start, last - start]
    return len(closures)


def clear(scene, name: str) -> None:
    """Takes the strips of a sound away."""
    editor = scene.sequence_editor
    for strip in _of(scene, name):
        owner = editor.strips if hasattr(editor, "strips") else editor.sequences
        owner.remove(strip)


def read(scene, source) -> list[tuple[float, float, str]] | None:
    """Start and end in seconds, and the text, of each strip of a sound; None where it has none."""
    fps = scene.render.fps / scene.render.fps_base
    found = []
    for strip in _of(scene, source.name):
        ends = [at - round(source.start_frame) for at in sequencer.ends(strip)]
        if ends == list(strip.get(_FRAMES, ())):
            start_s, end_s = strip[_SECONDS]
        else:
            start_s, end_s = (max(0.0, at / fps) for at in ends)
        found.append((start_s, end_s, strip.text.strip()))
    return sorted(found) or None


def apart(labelled: list[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """The same intervals, each behind the one before: strips of two channels may overlap."""
    found, free = [], 0.0
    for start_s, end_s, label in labelled:
        if end_s > max(start_s, free):
            found.append((max(start_s, free), end_s, label or LABEL))
            free = end_s
    return found


def _of(scene, name: str) -> list:
    strips = sequencer.all_strips(scene)
    return [strip for strip in strips if strip.type == "TEXT" and strip.get(_SOUND) == name]


def _new(strips, channel: int, first: int, last: int):
    place = {"name": LABEL, "type": "TEXT", "channel": channel, "frame_start": first}
    if bpy.app.version >= (5, 0, 0):
        return strips.new_effect(**place, length=last - first)
    return strips.new_effect(**place, frame_end=last)
