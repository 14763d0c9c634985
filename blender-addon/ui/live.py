"""*Live*: the face follows its sound while that is played, before anything is generated."""

from bpy.types import Operator

from ..core import space
from ..scene import bake, live, outputs
from . import audio, running
from .operators import InThread
from .settings import from_object
from .target import sequencer_scene, target


class _Preparing:
    """Makes the face and the stream ready in a thread."""

    def __init__(self, snapshot):
        self.snapshot = snapshot

    def work(self, progress):
        """The `LiveFace`."""
        snapshot = self.snapshot
        voice, request = snapshot.heard(progress)
        face = snapshot.face
        seen = space.face_space(face.matrix_world, face.axes).seen(face)
        return snapshot.engine.live(*seen, voice, request, progress)


class ANYFACE_OT_live(InThread, Operator):
    """Follow the sound while it plays, without generating: play or scrub, and change the emotion \
meanwhile. Again ends it; so does saving, rendering and undo. Nothing of it stays"""

    bl_idname = "anyface.live"
    bl_label = "Live"

    busy = "Another face is being animated"

    @classmethod
    def poll(cls, context):
        """False, with the reason, without a face or a sound, and where a take plays already."""
        ob = target(context)
        if ob is not None and live.is_on(ob):
            return True
        if not super().poll(context):
            return False
        reason = audio.why_not(ob, sequencer_scene(context)) if ob.library is None else ""
        if outputs.has_take(ob):
            reason = "The face plays a take: remove it first"
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context):
        """On or off."""
        if self._off(context):
            return {"FINISHED"}
        return super().execute(context)

    def invoke(self, context, event):
        """The same, with the work in a thread."""
        if self._off(context):
            return {"FINISHED"}
        return super().invoke(context, event)

    def _off(self, context) -> bool:
        return live.end(target(context))

    def read(self, context, ob):
        """The face and its sound."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        # Whatever is asked of the output, live needs one key of its own.
        settings.mode = "basis"
        return _Preparing(bake.read(ob, scene, settings, running.engine(settings.system)))

    def finish(self, ob, preparing, face):
        """Begins to follow."""
        try:
            live.begin(ob, preparing.snapshot, face)
        except BaseException:
            face.close()
            raise
        self.report({"INFO"}, "Anyface: the face follows the sound: play, or go to another frame")
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_live,)
