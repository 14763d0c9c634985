"""*Heat Map*: how strongly emotion moves each part of the face now, as a colour attribute."""

from bpy.types import Operator

from ..core import systems
from ..core.job import Work
from ..scene import bake
from ..scene.face import emotion_mask
from . import running
from .audio import WithSound
from .operators import Acting, InThread
from .settings import from_object
from .target import sequencer_scene, target


class ANYFACE_OT_heat_map(WithSound, InThread, Operator):
    """Colour the face by how strongly emotion moves it in the current frame: red where emotion \
does, blue where speech alone does. A material, or the viewport's Attribute colour, shows the \
colours"""

    bl_idname = "anyface.heat_map"
    bl_label = "Heat Map"

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        if reason or systems.by_name(target(context).anyface.system).hears_emotion:
            return reason
        return "This system does not tell emotion from speech"

    def read(self, context, ob):
        """Reads the face, its sound, and the current frame of the take."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        snapshot = bake.read(ob, scene, settings, running.engine(settings.system))
        seconds = (scene.frame_current_final - snapshot.source.start_frame) / snapshot.scene_fps
        frame = round(seconds * snapshot.request.fps)
        return Work(lambda progress: snapshot.ask(snapshot.engine.mask, progress, frame))

    def finish(self, ob, _work, shares):
        """Colours the face's own vertices by shares `[V]`."""
        emotion_mask.show_heat(ob, shares[: len(ob.data.vertices)])
        return f"emotion moves the face by {shares.mean():.0%} on average"


class ANYFACE_OT_heat_map_hide(Acting, Operator):
    """Remove the colours of the heat map"""

    bl_idname = "anyface.heat_map_hide"
    bl_label = "Hide Heat Map"

    @classmethod
    def why_not(cls, context):
        reason = super().why_not(context)
        shown = not reason and emotion_mask.shows_heat(target(context))
        return reason or ("" if shown else "No heat map is shown")

    def act(self, ob):
        """Removes the colours."""
        emotion_mask.hide_heat(ob)
