"""*Choose a Sound File…*: adds a strip to the sequencer, which the face speaks."""

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy.types import Operator

from ..core.errors import AnyfaceError, readable
from ..scene.sound import sequencer
from .operators import WithFile
from .target import sequencer_scene

_SOUNDS = "*.wav;*.mp3;*.flac;*.ogg;*.m4a;*.aac;*.aif;*.aiff;*.opus;*.mp4;*.mov;*.mkv"


class ANYFACE_OT_choose_sound(WithFile, Operator):
    """Add a sound file to the sequencer at the current frame; the face speaks it"""

    bl_idname = "anyface.choose_sound"
    bl_label = "Choose a Sound File"

    filter_glob: StringProperty(default=_SOUNDS, options={"HIDDEN"})

    def act(self, ob):
        """Adds the strip, makes the face speak it, and clears an earlier error."""
        if not self.path.is_file():
            raise AnyfaceError("audio", f"no sound file at {self.filepath or 'an empty path'}")
        if self.path.stat().st_size == 0:
            raise AnyfaceError("audio", f"{self.path.name} is empty: choose another sound file")
        scene = sequencer_scene(bpy.context)
        for block in (ob, scene):
            if block.library is not None:
                text = f"{block.name} is linked and keeps no settings: make it local"
                raise AnyfaceError("mesh", text)
        message = _speak(ob, scene, _kept_path(self.filepath))
        if ob.anyface.report_is_error:
            ob.anyface.report, ob.anyface.report_mends = "", ""
            ob.anyface.report_is_error = False
        return message


def _speak(ob, scene, path: str) -> str:
    """Makes `ob` speak the sound file at `path` as a strip of `scene`; returns a message."""
    frame = scene.frame_current
    try:
        strip = sequencer.add_sound(scene, path, frame)
    except RuntimeError as error:
        # Anyface reads files that Blender cannot, and some builds of Blender play no sound.
        ob.anyface.source, ob.anyface.sound_file = "FILE", path
        ob.anyface.start_frame = frame
        why = readable(error)
        return f"Blender cannot play {Path(path).name} ({why}), but the face can speak it"
    ob.anyface.source, ob.anyface.strip = "STRIP", strip.name
    return f"{strip.name} plays from frame {frame} on, channel {strip.channel} of the sequencer"


def _kept_path(path: str) -> str:
    """A path as Blender's own buttons store it, relative to the .blend if preferences say so."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return path
    try:
        return bpy.path.relpath(bpy.path.abspath(path))
    except ValueError:
        # On Windows, the file is on another drive.
        return path
