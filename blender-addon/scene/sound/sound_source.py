"""The sound of a strip or a file: the part that plays, and the frame at which it begins."""

import os
import tempfile

import bpy

from ...core.errors import AnyfaceError
from ...core.source import Decode, SoundSource
from . import sequencer


def from_file(path: str, start_frame: float) -> SoundSource:
    """A whole sound file."""
    full = bpy.path.abspath(path)
    if not path or not os.path.isfile(full):
        text = f"no sound file at {full or 'an empty path'}: choose another one"
        raise AnyfaceError("audio", text, ("choose_sound",))
    return SoundSource(full, os.path.basename(full), start_frame)


def from_strip(scene, name: str, decode: Decode) -> SoundSource:
    """The part of a sound strip that plays. The strip may be trimmed, retimed or packed."""
    strip = sequencer.sound_strip(scene, name)
    if strip.sound is None:
        raise AnyfaceError("audio", f"the strip {name} holds no sound")
    start, end = sequencer.ends(strip)
    source = _file_of(strip.sound, name, start)
    fps = scene.render.fps / scene.render.fps_base
    if sequencer.is_retimed(strip, lambda: source.load(decode).duration_s * fps):
        return _mix_down(scene, strip)
    # From 4.3 on `sound_offset` moves the content inside the strip, in seconds.
    offset_s = getattr(strip, "sound_offset", 0.0)
    source.first_s = (start - sequencer.content_start(strip)) / fps - offset_s
    source.last_s = source.first_s + (end - start) / fps
    return source


def _file_of(sound, name: str, start_frame: float) -> SoundSource:
    """The file of a sound; a packed sound is written to a temporary file."""
    if sound.packed_file is None:
        path = bpy.path.abspath(sound.filepath, library=sound.library)
        if not os.path.isfile(path):
            text = f"{sound.name}: no sound file at {path}"
            raise AnyfaceError("audio", text, ("find_files", "choose_sound"))
        return SoundSource(path, name, start_frame)
    folder = tempfile.TemporaryDirectory(prefix="anyface-")
    suffix = os.path.splitext(sound.filepath)[1] or ".wav"
    path = os.path.join(folder.name, "packed" + suffix)
    with open(path, "wb") as file:
        file.write(sound.packed_file.data)
    return SoundSource(path, name, start_frame, folder=folder)


def _mix_down(scene, strip) -> SoundSource:
    """Mixes down a retimed strip as Blender plays it. All other strips are muted meanwhile."""
    others = [other for other in sequencer.all_strips(scene) if other != strip]
    muted = [(other, other.mute) for other in others]
    before = strip.mute, scene.frame_start, scene.frame_end
    start, end = sequencer.ends(strip)
    folder = tempfile.TemporaryDirectory(prefix="anyface-")
    path = os.path.join(folder.name, "strip.wav")
    try:
        for other in others:
            other.mute = True
        strip.mute = False
        scene.frame_start, scene.frame_end = start, max(end - 1, start)
        with bpy.context.temp_override(**sequencer.override(scene)):
            bpy.ops.sound.mixdown(
                filepath=path,
                container="WAV",
                codec="PCM",
                format="S16",
                channels="MONO",
                check_existing=False,
            )
    except RuntimeError as error:
        raise AnyfaceError("audio", f"{strip.name}: {str(error).strip()}") from error
    finally:
        for other, mute in muted:
            other.mute = mute
        strip.mute, scene.frame_start, scene.frame_end = before
    return SoundSource(path, strip.name, start, folder=folder)
