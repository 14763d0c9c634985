"""Generate and Cancel."""

import bpy
from bpy.types import Operator

from ..scene import bake, outputs
from . import character, running
from .operators import InThread, redraw
from .settings import from_object
from .target import sequencer_scene


class ANYFACE_OT_generate(InThread, Operator):
    """Animate the face with the sound; an earlier take on it is replaced"""

    bl_idname = "anyface.generate"
    bl_label = "Generate"

    busy = "Another face is being animated"

    def read(self, context, ob):
        """The settings, the mesh and the sound."""
        scene = sequencer_scene(context)
        settings = from_object(ob, scene)
        return bake.read(ob, scene, settings, running.engine(settings.system))

    def land(self, ob, snapshot, take):
        """Writes the take in steps."""
        text = yield from bake.landing(ob, snapshot, take)
        return self._tell(ob, take, text)

    def finish(self, ob, snapshot, take):
        """Writes the take."""
        return self._tell(ob, take, bake.write(ob, snapshot, take))

    def _tell(self, ob, take, text: str):
        left = character.left_behind(ob) if outputs.of_take(take).moves_parts else ""
        text = f"{text} ({left})" if left else text
        ob.anyface.report, ob.anyface.report_is_error = text, False
        self.report({"INFO"}, f"Anyface: {text}")
        return {"FINISHED"}

    def fail(self, error, ob=None):
        """Keeps the error in the panel as well."""
        # A linked object cannot keep the text; the report still shows it.
        if ob is not None and ob.library is None:
            ob.anyface.report, ob.anyface.report_is_error = str(error), True
        redraw(bpy.context)
        return super().fail(error)


class ANYFACE_OT_cancel(Operator):
    """Stop the running animation; nothing is written"""

    bl_idname = "anyface.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return running.is_running()

    def execute(self, context):
        """Asks the thread to stop; the running operator ends with it."""
        running.current.cancel()
        return {"FINISHED"}


CLASSES = (ANYFACE_OT_generate, ANYFACE_OT_cancel)
