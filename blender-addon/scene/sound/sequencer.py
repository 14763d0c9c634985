"""The sequencer across Blender's versions.

4.2 has `sequences`, and 5.0 has only `strips`. 5.2 adds new names for the frames of a strip. 6.0
will have only the new names.
"""

import os
from collections.abc import Callable

import bpy

from ...core.errors import AnyfaceError

MAX_CHANNELS = 128
CAMERA_KEPT = "Sequencer in Output, Post Processing is off, so that the camera is rendered"


def all_strips(scene) -> list:
    """Every strip of a scene, including those inside meta strips."""
    editor = scene.sequence_editor
    if editor is None:
        return []
    return list(editor.strips_all if hasattr(editor, "strips_all") else editor.sequences_all)


def sound_strips(scene) -> list:
    """The sound strips of a scene, first to last."""
    strips = [strip for strip in all_strips(scene) if strip.type == "SOUND"]
    return sorted(strips, key=lambda strip: (ends(strip)[0], strip.channel))


def outer_strips(editor):
    """The strips of a sequencer that are outside meta strips, as a collection."""
    return editor.strips if hasattr(editor, "strips") else editor.sequences


def add_sound(scene, path: str, frame: int):
    """Adds a strip of the sound file at `path` that begins at `frame` and is not muted.

    If such a strip already exists, it is used instead. Raises `RuntimeError` if Blender cannot read
    the file, and `AnyfaceError("audio")` if no channel is free.
    """
    strip = _standing(scene, path, frame)
    if strip is None:
        strip = _new_sound(scene.sequence_editor_create(), path, frame)
    strip.mute = False
    return strip


def _standing(scene, path: str, frame: int):
    """An existing strip of the sound file at `path` that begins at `frame`, or None."""
    full = os.path.normcase(os.path.abspath(bpy.path.abspath(path)))
    for strip in sound_strips(scene):
        sound = strip.sound
        if sound is None or ends(strip)[0] != frame:
            continue
        strip_path = bpy.path.abspath(sound.filepath, library=sound.library)
        if os.path.normcase(os.path.abspath(strip_path)) == full:
            return strip
    return None


def _new_sound(editor, path: str, frame: int):
    strips = outer_strips(editor)
    spans = [(strip.channel, *ends(strip)) for strip in strips]
    highest = min(max((channel for channel, *_ in spans), default=0) + 1, MAX_CHANNELS)
    # Only an existing strip has a length, so it is created first and moved to a free channel.
    name = os.path.splitext(os.path.basename(path))[0]
    strip = strips.new_sound(name, path, highest, frame)
    if strip.sound is None or strip.sound.samplerate == 0:
        _drop(strips, strip)
        raise RuntimeError("unknown format")
    first, last = ends(strip)
    for channel in range(1, MAX_CHANNELS + 1):
        row = editor.channels[channel]
        if row.mute or row.lock:
            continue
        if all(last <= a or b <= first for at, a, b in spans if at == channel):
            strip.channel = channel
            return strip
    _drop(strips, strip)
    text = f"no channel of the sequencer is free at frame {frame}: unmute or clear one"
    raise AnyfaceError("audio", text)


def _drop(strips, strip) -> None:
    sound = strip.sound
    strips.remove(strip)
    if sound is not None and sound.users == 0:
        bpy.data.sounds.remove(sound)


def ends(strip) -> tuple[int, int]:
    """The first frame that a strip plays, and the frame after its last one."""
    if hasattr(strip, "left_handle"):
        return strip.left_handle, strip.right_handle
    return strip.frame_final_start, strip.frame_final_end


def place(strip, first: int, last: int) -> None:
    """Makes a text strip play from frame `first` up to, but not including, frame `last`."""
    names = ("left_handle", "right_handle")
    if not hasattr(strip, "left_handle"):
        names = ("frame_final_start", "frame_final_end")
    ends_new = list(zip(names, (first, last), strict=True))
    # A strip may never end before it starts, so a move to later frames sets the end first.
    for name, frame in ends_new[::-1] if first > ends(strip)[0] else ends_new:
        setattr(strip, name, frame)


def new_text(scene, name: str, channel: int, first: int, last: int):
    """A new muted text strip from frame `first` up to, but not including, frame `last`.

    The scene renders as before.
    """
    strips = outer_strips(scene.sequence_editor_create())
    _keep_camera(scene)
    place = {"name": name, "type": "TEXT", "channel": channel, "frame_start": first}
    if bpy.app.version >= (5, 0, 0):
        strip = strips.new_effect(**place, length=last - first)
    else:
        strip = strips.new_effect(**place, frame_end=last)
    strip.mute = True
    return strip


def _keep_camera(scene) -> None:
    """Takes the sequencer out of the render where it has nothing but sounds and muted texts.

    4.3 renders the sequencer instead of the camera as soon as it has a strip that is no sound, even
    a muted one, and then the picture is empty. 5.0 does not. The sound of videos stays.
    """
    pictures = [strip for strip in all_strips(scene) if strip.type != "SOUND"]
    shows = (strip.type != "TEXT" or not strip.mute for strip in pictures)
    if bpy.app.version < (5, 0, 0) and scene.render.use_sequencer and not any(shows):
        scene.render.use_sequencer = False


def with_camera_kept(scene, was_used: bool, text: str) -> str:
    """`text`, and a sentence if adding strips has taken the sequencer out of the render."""
    return f"{text}. {CAMERA_KEPT}" if was_used and not scene.render.use_sequencer else text


def content_start(strip) -> float:
    """The frame at which the whole sound would begin if it were not trimmed."""
    return strip.content_start if hasattr(strip, "content_start") else strip.frame_start


def sound_strip(scene, name: str):
    """The sound strip called `name`.

    If there is none, raises `AnyfaceError("audio")` with the existing names.
    """
    strips = sound_strips(scene)
    for strip in strips:
        if strip.name == name:
            return strip
    known = ", ".join(strip.name for strip in strips) or "none"
    text = f"expected a sound strip of {scene.name} ({known}), got {name!r}"
    raise AnyfaceError("audio", text, ("choose_sound",))


def is_retimed(strip, sound_frames: Callable[[], float]) -> bool:
    """Whether a strip plays faster or slower than its sound, `sound_frames()` frames long."""
    if hasattr(strip, "retiming_keys"):
        return len(strip.retiming_keys) > 0
    # 4.2 hides the retiming keys, but a retimed strip is longer or shorter than its sound.
    return abs(strip.frame_duration - sound_frames()) > 2.0


def override(scene) -> dict:
    """The arguments for `temp_override` that make sequencer operators work on `scene`."""
    if bpy.app.version >= (5, 0, 0):
        return {"scene": scene, "sequencer_scene": scene}
    return {"scene": scene}
