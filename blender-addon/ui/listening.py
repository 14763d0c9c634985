"""*Live Microphone*: the face follows a voice in the room, which can be recorded."""

import bpy
from bpy.types import Operator

from ..core import microphone
from ..core.errors import AnyfaceError
from ..core.job import Work
from ..scene import bake, live, outputs
from ..scene.sound import recording, sequencer
from . import preferences, running
from .operators import Alone, InThread
from .settings import from_object
from .target import sequencer_scene, target

# A recording shorter than this counts as a mistake, seconds.
_SHORTEST_S = 0.2


class ANYFACE_OT_listen(InThread, Operator):
    """Follow the microphone: the face speaks with you, a quarter of a second later, or sooner by \
Microphone Delay in the preferences. Press again to stop; saving, rendering and undo stop it too. \
Only what you record is kept"""

    bl_idname = "anyface.listen"
    bl_label = "Live Microphone"

    busy = "Another face is being animated"

    @classmethod
    def why_not(cls, context):
        ob = target(context)
        if ob is not None and live.listens(ob):
            return ""
        if reason := microphone.why_missing():
            return f"This package of Anyface hears no microphone: {reason}"
        plays = "The face plays a take: remove it first" if outputs.has_take(ob) else ""
        return super().why_not(context) or plays

    def instead(self, context):
        """Stops listening, if the face listens."""
        ob = target(context)
        return live.listens(ob) and live.end(ob)

    def read(self, context, ob):
        """Reads the face."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        # Listening needs a key of its own, whichever output is chosen.
        settings.mode = "basis"
        face, request = bake.read_still(ob, scene, settings)
        engine, mesh = running.engine(settings.system), face.space.to_library(face)
        device = preferences.microphone(), preferences.look_ahead()
        return Work(
            lambda progress: engine.live_microphone(*mesh, *device, request, progress), face
        )

    def finish(self, ob, work, face):
        """Lets the face follow the microphone."""
        live.begin(ob, work.about, face)
        return f"{ob.name} listens to {face.name}, {face.delay_s:.2f} s behind"


class ANYFACE_OT_record(Alone, Operator):
    """Record what the microphone hears. Press again to stop: the recording becomes a strip of the \
sequencer at the frame where it began, and the face is animated with it"""

    bl_idname = "anyface.record"
    bl_label = "Record"

    @classmethod
    def why_not(cls, context):
        ob = target(context)
        silent = "" if ob is not None and live.listens(ob) else "Turn on Live Microphone first"
        return super().why_not(context) or silent

    def act(self, ob):
        """Starts or ends the recording."""
        scene, face = sequencer_scene(bpy.context), live.listener(ob)
        if not face.is_recording:
            face.record(scene.frame_current)
            return "recording"
        sound, frame = face.recording()
        if len(sound.samples) < _SHORTEST_S * sound.rate_hz:
            face.drop_recording()
            raise AnyfaceError("audio", "record: expected a recording of 0.2 s or more")
        # If this fails, the recording goes on, and the artist can press the button again.
        strip = keep(ob, scene, sound, frame)
        live.end(ob)
        bpy.ops.anyface.generate("INVOKE_DEFAULT")
        return f"{len(sound.samples) / sound.rate_hz:.1f} s recorded as {strip.name}"


def keep(ob, scene, sound, frame: int):
    """Adds the recording as a strip at `frame`, lets `ob` speak it, and returns the strip.

    Raises `AnyfaceError`.
    """
    try:
        path = recording.write(sound)
    except OSError as error:
        raise AnyfaceError("file", f"the recording cannot be written: {error}") from error
    try:
        strip = sequencer.add_sound(scene, str(path), frame)
    except RuntimeError as error:
        # The file stays: it is the only copy of the recording.
        raise AnyfaceError("audio", f"Blender cannot play {path}: {error}") from error
    if not bpy.data.filepath:
        # The temporary folder is deleted when Blender ends, so the .blend packs the sound.
        strip.sound.pack()
    ob.anyface.source, ob.anyface.strip = "STRIP", strip.name
    return strip
