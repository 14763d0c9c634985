"""*Live*: the face follows its sound during playback, before anything is generated."""

from bpy.types import Operator

from ..core.job import Work
from ..scene import bake, live, outputs
from . import running
from .audio import WithSound
from .operators import InThread
from .settings import from_object
from .target import sequencer_scene, target


class ANYFACE_OT_live(WithSound, InThread, Operator):
    """Follow the sound while it plays, without generating: play or scrub, and change the emotion \
meanwhile. Press again to stop; saving, rendering and undo stop it too. Nothing is kept"""

    bl_idname = "anyface.live"
    bl_label = "Live"

    busy = "Another face is being animated"

    accepts_linked = True

    @classmethod
    def why_not(cls, context):
        ob = target(context)
        if ob is not None and live.is_on(ob) and not live.listens(ob):
            return ""
        plays = "The face plays a take: remove it first" if outputs.has_take(ob) else ""
        return super().why_not(context) or plays

    def instead(self, context):
        """Stops following, if the face follows its sound."""
        ob = target(context)
        return not live.listens(ob) and live.end(ob)

    def read(self, context, ob):
        """Reads the face and its sound."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        # *Live* needs a key of its own, whichever output is chosen.
        settings.mode = "basis"
        snapshot = bake.read(ob, scene, settings, running.engine(settings.system))
        return Work(lambda progress: snapshot.ask(snapshot.engine.live, progress), snapshot)

    def finish(self, ob, work, face):
        """Lets the face follow its sound."""
        live.begin(ob, work.about.face, face, work.about.source.start_frame)
        return "the face follows the sound: play, or go to another frame"
