"""What operators have in common: how they say what went wrong, and how they work in a thread."""

import time
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.errors import AnyfaceError
from ..core.job import BEGUN, Job, Progress
from ..scene import copies, identity
from . import running
from .target import OfFace, target

# So long a take is written before the interface is asked again, seconds.
SLICE_S = 0.02


class Notice(AnyfaceError):
    """Nothing was done, for a reason that is no error: scripts go on."""

    def __init__(self, message: str):
        super().__init__("input", message)


class Acting(OfFace):
    """Does `act(ob)` with the character, which may return what to tell the artist."""

    def execute(self, context):
        """Does it, or says why not."""
        copies.settle()
        try:
            return self.tell(self.act(target(context)))
        except AnyfaceError as error:
            return self.fail(error)

    def tell(self, text):
        """Says what was done, where there is something to say."""
        if text:
            self.report({"INFO"}, f"Anyface: {text}")
        return {"FINISHED"}

    def fail(self, error, _ob=None):
        """Shows the error where the artist looks."""
        self.report({"WARNING" if isinstance(error, Notice) else "ERROR"}, f"Anyface: {error}")
        return {"CANCELLED"}


class WithFile(Acting):
    """Asks for a file first; one of JSON where nothing else is said."""

    filepath: StringProperty(subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def invoke(self, context, event):
        """Opens the file browser."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @property
    def path(self) -> Path:
        """The file, from wherever the .blend lies."""
        return Path(bpy.path.abspath(self.filepath))


class ToFile(WithFile):
    """Saves something of the character as a JSON file."""

    bl_options = {"REGISTER"}
    # What is saved, as it stands in the name of the file.
    what = ""

    def invoke(self, context, event):
        """Asks for the file."""
        self.filepath = self.filepath or f"{target(context).name}_{self.what}.json"
        return super().invoke(context, event)

    @property
    def path(self):
        return Path(bpy.path.ensure_ext(str(super().path), ".json"))


class Alone(Acting):
    """Works only while no job runs."""

    busy = "Another job is running"

    @classmethod
    def why_not(cls, context):
        return cls.busy if running.is_running() else super().why_not(context)


class InThread(Alone):
    """Works in a thread while Blender goes on, or at once without a window.

    `read(context, ob)` returns something with `work(progress)`, which is what runs in the thread;
    `finish(ob, read, worked)` writes what that has returned, and may return what to tell the
    artist. Where this takes long, `land` of the same arguments does it in steps: a generator that
    has changed nothing until it yields `BEGUN`.
    """

    cancelled = "cancelled"
    _landing = None
    # The result is being written: only an undo, or another file, ends that.
    _begun = False

    def face(self, context):
        """The character; None for an operator that has no single one."""
        return target(context)

    def execute(self, context):
        """Everything at once: for scripts and for Blender without a window."""
        ob = self.face(context)
        try:
            snapshot = self.read(context, ob)
            return self.tell(self.finish(ob, snapshot, snapshot.work(Progress())))
        except AnyfaceError as error:
            return self.fail(error, ob)

    def invoke(self, context, event):
        """Reads now, works in a thread, writes when that is done."""
        if bpy.app.background:
            return self.execute(context)
        ob = self.face(context)
        try:
            self._snapshot = self.read(context, ob)
        except AnyfaceError as error:
            return self.fail(error, ob)
        self._name, self._number = (ob.name, identity.number(ob)) if ob is not None else ("", 0)
        self._job = running.start(Job(self._snapshot.work), self._name or "Scene")
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Polls the thread; ESC cancels."""
        redraw_sidebar(context)
        if event.type == "ESC" and event.value == "PRESS" and not self._begun:
            self._job.cancel()
        if self._job.progress.cancelled and (running.why_cancelled or not self._begun):
            why = running.why_cancelled
            self._end(context)
            if why or self.cancelled:
                self.report({"INFO"}, f"Anyface: {why or self.cancelled}")
            return {"CANCELLED"}
        if event.type != "TIMER" or not self._job.done:
            return {"PASS_THROUGH"}
        ob = identity.with_number(self._number, self._name)
        try:
            if self._name and ob is None:
                raise AnyfaceError("mesh", f"{self._name} is gone")
            if self._landing is None:
                self._landing = self.land(ob, self._snapshot, self._job.result())
                self._hurry(context)
            return self._slice(context)
        except AnyfaceError as error:
            self._end(context)
            return self.fail(error, ob)

    def land(self, ob, read, worked):
        """Everything at once, in one step."""
        return self.finish(ob, read, worked)
        yield

    def _slice(self, context):
        """Writes for a moment; the interface has the next one."""
        ends = time.perf_counter() + SLICE_S
        try:
            while time.perf_counter() < ends:
                if next(self._landing) == BEGUN:
                    # Blender evaluates this much before more is written.
                    self._begun = True
                    break
        except StopIteration as ended:
            self._end(context)
            return self.tell(ended.value)
        return {"PASS_THROUGH"}

    def _hurry(self, context):
        """From now on Blender asks more often."""
        context.window_manager.event_timer_remove(self._timer)
        self._timer = context.window_manager.event_timer_add(SLICE_S, window=context.window)

    def cancel(self, context):
        """Blender closes or loads another file."""
        self._job.cancel()
        self._end(context)

    def _end(self, context):
        context.window_manager.event_timer_remove(self._timer)
        if self._landing is not None:
            self._landing.close()
        running.finish()
        redraw(context)


def redraw(context) -> None:
    """Draws every 3D view again."""
    for area in _views(context):
        area.tag_redraw()


def redraw_sidebar(context) -> None:
    """Draws what shows the progress again: the scene itself may take long to draw."""
    for area in _views(context):
        for region in area.regions:
            if region.type == "UI":
                region.tag_redraw()


def _views(context) -> list:
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    return [area for area in areas if area.type == "VIEW_3D"]
