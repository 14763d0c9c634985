"""Operators that follow the pointer in a 3D view until Return or Esc."""

import bpy

from ..core.errors import plain
from ..core.job import Job
from ..scene.way_back import unharmed
from . import details, running
from .operators import Alone, redraw
from .target import target


class InView(Alone):
    """Follows the pointer; any error ends it, and the artist sees the message.

    `begin(ob)` prepares it. `follow(ob, event, view)` gets every event with the view under the
    pointer, see `view_under`. `finish(ob, job)` writes the result of a search and returns whether
    that was all.
    """

    # Every step is an undo step of its own, so ending the operator adds none.
    bl_options = {"REGISTER", "BLOCKING"}
    # The text in the status bar while it runs.
    words = ""
    _job = _timer = None

    def invoke(self, context, event):
        """Waits for the pointer."""
        if bpy.app.background or context.region_data is None:
            return self.execute(context)
        self._name = target(context).name
        try:
            self.begin(target(context))
            context.window_manager.anyface_show_landmarks = True
            context.workspace.status_text_set(self.words)
            self._timer = context.window_manager.event_timer_add(0.05, window=context.window)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        except BaseException as error:
            return self._break(context, error)

    def modal(self, context, event):
        """Handles one event."""
        try:
            return self._modal(context, event)
        except BaseException as error:
            return self._break(context, error)

    def _modal(self, context, event):
        redraw(context)
        ob = bpy.data.objects.get(self._name)
        ends = event.type in {"ESC", "RET", "NUMPAD_ENTER"} and event.value == "PRESS"
        if ob is None or ends:
            return self._end(context)
        if self._job is not None:
            return self._wait(context, ob)
        return self.follow(context, ob, event, view_under(context, event))

    def search(self, ob, search) -> None:
        """Starts a search in a thread."""
        self._job = running.start(Job(search.work), ob.name)

    def _wait(self, context, ob):
        if not self._job.done:
            return {"RUNNING_MODAL"}
        job, self._job = self._job, None
        running.finish()
        self.clear()
        is_all = self.finish(ob, job)
        return self._end(context) if is_all else {"RUNNING_MODAL"}

    def clear(self) -> None:
        """Removes drawings that only this operator shows."""

    def _break(self, context, raised: BaseException):
        """Ends the operator after an error and tells the artist; finished steps stay."""
        self._end(context)
        error = plain(raised)
        with unharmed():
            error = details.save(error)
        return self.fail(error)

    def _end(self, context):
        self.cancel(context)
        with unharmed():
            redraw(context)
        return {"FINISHED"}

    def cancel(self, context):
        """Stops when the artist ends it, or when Blender closes or loads another file."""
        with unharmed():
            self.clear()
        job, timer = self._job, self._timer
        self._job = self._timer = None
        if job is not None:
            running.finish()
            with unharmed():
                job.cancel()
        with unharmed():
            context.workspace.status_text_set(None)
        with unharmed():
            if timer is not None:
                context.window_manager.event_timer_remove(timer)


def view_under(context, event):
    """The region, its view and the pointer in it; None if the pointer is outside all 3D views."""
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        for region in area.regions:
            x, y = event.mouse_x - region.x, event.mouse_y - region.y
            if region.type == "WINDOW" and 0 <= x < region.width and 0 <= y < region.height:
                return region, area.spaces.active.region_3d, (x, y)
    return None
