"""Generate and Cancel."""

import bpy
from bpy.types import Operator

from ..core.job import BEGUN
from ..scene import bake, outputs
from ..scene.takes import panel_settings
from . import character, mending, running
from .audio import WithSound
from .operators import InThread, redraw
from .settings import from_object
from .target import sequencer_scene


class ANYFACE_OT_generate(WithSound, InThread, Operator):
    """Animate the face with the sound; an earlier take on it is replaced, or kept in Takes if you \
corrected it"""

    bl_idname = "anyface.generate"
    bl_label = "Generate"

    busy = "Another face is being animated"

    accepts_linked = True

    def read(self, context, ob):
        """Reads the settings, the mesh and the sound; adds teeth and tongue as parts."""
        scene = sequencer_scene(context)
        outputs.of(ob.anyface.mode).check_object(ob)
        self._along = character.take_along(ob)
        settings = from_object(ob, scene)
        return bake.read(ob, scene, settings, running.engine(settings.system))

    def land(self, ob, snapshot, take):
        """Writes the take in steps; after the last one Blender pushes the undo step."""
        text = yield from bake.landing(ob, snapshot, take)
        yield BEGUN
        return self._tell(ob, snapshot, take, text)

    def finish(self, ob, snapshot, take):
        """Writes the take."""
        return self._tell(ob, snapshot, take, bake.write(ob, snapshot, take))

    def _tell(self, ob, snapshot, take, text: str):
        left = character.left_behind(ob) if outputs.of_take(take).moves_parts else ""
        text = f"{text} ({left})" if left else text
        for more in _said_once(self._along, bpy.context.scene):
            text = f"{text} ({more})"
        mends = ["find_parts"] if left else []
        ob.anyface.report, ob.anyface.report_is_error = text, False
        mending.keep(ob, mends)
        panel_settings.note(ob, snapshot.panel_values, text)
        return " ".join([text, *(f"({more})" for more in mending.said_of_scene(ob))])

    def fail(self, error, ob=None):
        """Shows the error in the panel as well."""
        # A linked object cannot store the text; the status bar still shows it.
        if ob is not None and ob.library is None:
            ob.anyface.report, ob.anyface.report_is_error = str(error), True
            mending.keep(ob, getattr(error, "mends", ()))
        redraw(bpy.context)
        return super().fail(error)


def _said_once(along: list[str], scene) -> list[str]:
    """Sets *Sync to Audio* once per scene; returns notes about that and about added parts."""
    notes = character.told(along)
    if not scene.anyface.synced:
        scene.anyface.synced = True
        if scene.sync_mode != "AUDIO_SYNC":
            scene.sync_mode = "AUDIO_SYNC"
            notes.append("Playback is set to Sync to Audio")
    return notes


class ANYFACE_OT_cancel(Operator):
    """Stop the running animation; nothing is written"""

    bl_idname = "anyface.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return running.is_running()

    def execute(self, context):
        """Asks the thread to stop; then the running operator ends."""
        running.current.cancel()
        return {"FINISHED"}
