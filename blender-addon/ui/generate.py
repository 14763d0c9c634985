"""Generate and Cancel."""

import bpy
from bpy.types import Operator

from ..core.errors import AnyfaceError
from ..core.job import Job, Progress
from ..scene import bake, outputs
from . import character, running
from .settings import from_object
from .target import OfFace, sequencer_scene, target


class ANYFACE_OT_generate(OfFace, Operator):
    """Animate the face with the sound; an earlier take on it is replaced"""

    bl_idname = "anyface.generate"
    bl_label = "Generate"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if running.is_running():
            cls.poll_message_set("Another face is being animated")
            return False
        return super().poll(context)

    def execute(self, context):
        """Everything at once: for scripts and for Blender without a window."""
        ob = target(context)
        try:
            snapshot = self._read(context, ob)
            return self._finish(ob, snapshot, snapshot.work(Progress()))
        except AnyfaceError as error:
            return self._fail(ob, error)

    def invoke(self, context, event):
        """Reads now, works in a thread, writes when that is done."""
        if bpy.app.background:
            return self.execute(context)
        ob = target(context)
        try:
            self._snapshot = self._read(context, ob)
        except AnyfaceError as error:
            return self._fail(ob, error)
        self._job = running.start(Job(self._snapshot.work), ob.name)
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Polls the thread; ESC cancels."""
        _redraw(context)
        if event.type == "ESC" and event.value == "PRESS":
            self._job.cancel()
        if self._job.progress.cancelled:
            self._end(context)
            self.report({"INFO"}, "Anyface: cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER" or not self._job.done:
            return {"PASS_THROUGH"}
        self._end(context)
        ob = bpy.data.objects.get(self._snapshot.object_name)
        try:
            if ob is None:
                raise AnyfaceError("mesh", f"{self._snapshot.object_name} is gone")
            return self._finish(ob, self._snapshot, self._job.result())
        except AnyfaceError as error:
            return self._fail(ob, error)

    def cancel(self, context):
        """Blender closes or loads another file."""
        self._job.cancel()
        self._end(context)

    def _read(self, context, ob):
        engine = running.engine()
        scene = sequencer_scene(context)
        return bake.read(ob, scene, from_object(ob, scene), engine)

    def _finish(self, ob, snapshot, take):
        text = bake.write(ob, snapshot, take)
        moves_parts = outputs.of_take(take).moves_parts
        left = character.left_behind(ob) if moves_parts else ""
        text = f"{text} ({left})" if left else text
        ob.anyface.report, ob.anyface.report_is_error = text, False
        self.report({"INFO"}, f"Anyface: {text}")
        return {"FINISHED"}

    def _fail(self, ob, error):
        # A linked object cannot keep the text; the report still shows it.
        if ob is not None and ob.library is None:
            ob.anyface.report, ob.anyface.report_is_error = str(error), True
        _redraw(bpy.context)
        self.report({"ERROR"}, f"Anyface: {error}")
        return {"CANCELLED"}

    def _end(self, context):
        context.window_manager.event_timer_remove(self._timer)
        running.finish()
        _redraw(context)


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


def _redraw(context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


CLASSES = (ANYFACE_OT_generate, ANYFACE_OT_cancel)
