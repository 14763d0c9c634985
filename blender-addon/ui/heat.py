"""*Heat Map*: where feeling is believed in the current frame, as a colour attribute."""

from bpy.types import Operator

from ..core import space, systems
from ..scene import bake
from ..scene.face import feeling_mask
from . import running
from .operators import InThread
from .settings import from_object
from .sounds import WithSound
from .target import sequencer_scene, target


class _Believing:
    """Asks the model what it believes of one frame of a take."""

    def __init__(self, snapshot, frame: int):
        self._snapshot, self._frame = snapshot, frame

    def work(self, progress):
        """Shares `[V]` of the face's own vertices."""
        snapshot = self._snapshot
        voice, request = snapshot.heard(progress)
        face = snapshot.face
        seen = space.face_space(face.matrix_world, face.axes).seen(face)
        return snapshot.engine.mask(*seen, voice, request, self._frame, progress)


class ANYFACE_OT_heat_map(WithSound, InThread, Operator):
    """Colour the face by how far feeling is believed in the current frame: red where it moves \
the face, blue where only what is said does. Shown by a material, or the viewport's Attribute \
colour"""

    bl_idname = "anyface.heat_map"
    bl_label = "Heat Map"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """False, with the reason, where the system does not tell both apart."""
        if not super().poll(context):
            return False
        can = systems.hears_feeling(target(context).anyface.system)
        if not can:
            cls.poll_message_set("This system does not tell feeling from speech")
        return can

    def read(self, context, ob):
        """The face, its sound, and which frame of the take is shown."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        snapshot = bake.read(ob, scene, settings, running.engine(settings.system))
        seconds = (scene.frame_current_final - snapshot.source.start_frame) / snapshot.scene_fps
        return _Believing(snapshot, round(seconds * snapshot.request.fps))

    def finish(self, ob, believing, believed):
        """Writes the colours."""
        feeling_mask.show_heat(ob, believed[: len(ob.data.vertices)])
        self.report({"INFO"}, f"Anyface: feeling is believed by {believed.mean():.0%} in the mean")
        return {"FINISHED"}


class ANYFACE_OT_heat_map_hide(Operator):
    """Take the colours of the heat map away"""

    bl_idname = "anyface.heat_map_hide"
    bl_label = "Hide Heat Map"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """False where there are none."""
        ob = target(context)
        return feeling_mask.shows_heat(ob) if ob is not None and ob.type == "MESH" else False

    def execute(self, context):
        """Removes them."""
        feeling_mask.hide_heat(target(context))
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_heat_map, ANYFACE_OT_heat_map_hide)
