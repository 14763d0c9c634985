"""The sequencer across Blender's versions.

4.2 has `sequences`, 5.0 only `strips`; 5.2 names the frames of a strip anew, and 6.0 will have the
new names alone.
"""

from collections.abc import Callable

import bpy

from ...core.errors import AnyfaceError


def all_strips(scene) -> list:
    """Every strip of a scene, also those inside meta strips."""
    editor = scene.sequence_editor
    if editor is None:
        return []
    return list(editor.strips_all if hasattr(editor, "strips_all") else editor.sequences_all)


def sound_strips(scene) -> list:
    """The sound strips of a scene, first to last."""
    found = [strip for strip in all_strips(scene) if strip.type == "SOUND"]
    return sorted(found, key=lambda strip: (ends(strip)[0], strip.channel))


def ends(strip) -> tuple[int, int]:
    """The first frame that a strip plays, and the one after its last."""
    if hasattr(strip, "left_handle"):
        return strip.left_handle, strip.right_handle
    return strip.frame_final_start, strip.frame_final_end


def place(strip, first: int, last: int) -> None:
    """Lets a text strip play from frame `first` to `last`, which is the one after its last."""
    names = ("left_handle", "right_handle")
    if not hasattr(strip, "left_handle"):
        names = ("frame_final_start", "frame_final_end")
    ends_new = list(zip(names, (first, last), strict=True))
    # No strip may end before it starts, not even in between.
    for name, frame in ends_new[::-1] if first > ends(strip)[0] else ends_new:
        setattr(strip, name, frame)


def new_text(scene, name: str, channel: int, first: int, last: int):
    """A new text strip from frame `first` to `last`, which is the one after its last."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    place = {"name": name, "type": "TEXT", "channel": channel, "frame_start": first}
    if bpy.app.version >= (5, 0, 0):
        return strips.new_effect(**place, length=last - first)
    return strips.new_effect(**place, frame_end=last)


def content_start(strip) -> float:
    """The frame at which the whole sound would begin, were it not trimmed."""
    return strip.content_start if hasattr(strip, "content_start") else strip.frame_start


def sound_strip(scene, name: str):
    """The sound strip called `name`.

    Raises `AnyfaceError("audio")`, with the names that there are.
    """
    strips = sound_strips(scene)
    for strip in strips:
        if strip.name == name:
            return strip
    known = ", ".join(strip.name for strip in strips) or "none"
    text = f"expected a sound strip of {scene.name} ({known}), got {name!r}"
    raise AnyfaceError("audio", text, ("choose_sound",))


def is_retimed(strip, sound_frames: Callable[[], float]) -> bool:
    """True where the strip plays faster or slower than its sound of `sound_frames()` frames."""
    if hasattr(strip, "retiming_keys"):
        return len(strip.retiming_keys) > 0
    # 4.2 hides the keys, but a retimed strip has another length.
    return abs(strip.frame_duration - sound_frames()) > 2.0


def override(scene) -> dict:
    """What `temp_override` needs for operators of the sequencer to work on `scene`."""
    if bpy.app.version >= (5, 0, 0):
        return {"scene": scene, "sequencer_scene": scene}
    return {"scene": scene}
