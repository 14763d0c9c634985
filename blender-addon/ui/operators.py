"""Base classes of operators: they report errors, and work in a thread."""

import time
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.errors import AnyfaceError, plain, readable
from ..core.job import BEGUN, Job, Progress
from ..scene import bake, copies, identity
from ..scene.way_back import WayBack, unharmed
from . import details, running
from .target import OfFace, target

# Writing pauses after this time so that the interface gets a turn, seconds.
SLICE_S = 0.02


class Notice(AnyfaceError):
    """Nothing was done, but not because of an error: scripts go on."""

    def __init__(self, message: str):
        super().__init__("input", message)


class Acting(OfFace):
    """Calls `act(ob)` with the character; `act` may return a message for the artist."""

    def face(self, context):
        """The character; None for an operator that has no single one."""
        return target(context)

    def execute(self, context):
        """Acts, or reports why it cannot."""
        try:
            copies.settle()
            return self.tell(self.act(self.face(context)))
        except BaseException as error:
            return self.fail(_save_details(plain(error)))

    def tell(self, text):
        """Reports a message, if there is one."""
        if text:
            self.report({"INFO"}, f"Anyface: {text}")
        return {"FINISHED"}

    def fail(self, error, _ob=None):
        """Shows the error where the artist looks."""
        text = readable(f"Anyface: {error}")
        self.report({"WARNING" if isinstance(error, Notice) else "ERROR"}, text)
        return {"CANCELLED"}


class OnList(Acting):
    """Changes a list that is stored with the face."""

    @classmethod
    def why_not(cls, context):
        """The reason why the list cannot be changed now, or ""."""
        ob = target(context)
        linked = ob is not None and ob.library is not None
        return "The face is linked and keeps no list" if linked else super().why_not(context)


class WithFile(Acting):
    """Asks for a file first, a JSON file by default."""

    filepath: StringProperty(subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def invoke(self, context, event):
        """Opens the file browser."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @property
    def path(self) -> Path:
        """The absolute path of the file."""
        return Path(bpy.path.abspath(self.filepath))


class ToFile(WithFile):
    """Saves something of the character as a JSON file."""

    bl_options = {"REGISTER"}
    # What is saved, as a word for the file name.
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
    """Works in a thread while Blender stays usable. Without a window it works at once.

    `read(context, ob)` returns a snapshot. Only its `work(progress)` runs in the thread.
    `finish(ob, read, worked)` writes the result, and may return a message for the artist. If
    writing takes long, the generator `land` with the same arguments does it in steps. If it is
    closed before it yields `BEGUN`, nothing has changed.

    If any of these raises, the job ends and the artist sees the error. The scene is then as it was
    before anything was written, and the next job can start.
    """

    cancelled = "cancelled"
    # Whether a failure undoes everything that was written. An operator that writes several results
    # undoes each one separately.
    goes_back = True
    _landing = _job = _timer = _way_back = None
    _name, _number = "", 0
    # The result is being written. Only an undo, or opening another file, can stop that.
    _begun = False
    # The result is in the scene, and its files are in use.
    _written = False

    def instead(self, context) -> bool:
        """Does something that needs no job, and returns True; False if a job is needed."""
        return False

    def execute(self, context):
        """Does everything at once: for scripts and for Blender without a window."""
        worked = None
        try:
            if self.instead(context):
                return {"FINISHED"}
            self._remember(self.face(context))
            snapshot = self.read(context, self._here())
            worked = snapshot.work(Progress())
            self._open_way_back()
            message = self.finish(self._here(), snapshot, worked)
            self._close_way_back(worked)
            return self.tell(message)
        except BaseException as error:
            return self._break(context, error, worked)

    def invoke(self, context, event):
        """Reads now, works in a thread, and writes when that is done."""
        if bpy.app.background:
            return self.execute(context)
        try:
            if self.instead(context):
                return {"FINISHED"}
            self._remember(self.face(context))
            self._snapshot = self.read(context, self._here())
            job = Job(self._snapshot.work, bake.discard)
            self._job = running.start(job, self._name or "Scene")
            self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        except BaseException as error:
            return self._break(context, error)

    def modal(self, context, event):
        """Polls the thread; ESC cancels."""
        try:
            return self._modal(context, event)
        except BaseException as error:
            return self._break(context, error)

    def _modal(self, context, event):
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
        ob = self._here()
        if self._landing is None:
            self._worked = self._job.result()
            self._open_way_back()
            self._landing = self.land(ob, self._snapshot, self._worked)
            self._hurry(context)
        return self._slice(context)

    def land(self, ob, read, worked):
        """Writes everything at once, in one step."""
        return self.finish(ob, read, worked)
        yield

    def _slice(self, context):
        """Writes for a moment, then gives the interface a turn."""
        ends = time.perf_counter() + SLICE_S
        try:
            while time.perf_counter() < ends:
                if next(self._landing) == BEGUN:
                    # Stop here, so that Blender evaluates this much before the next step.
                    self._begun = True
                    break
        except StopIteration as ended:
            self._close_way_back(self._worked)
            self._end(context)
            return self.tell(ended.value)
        return {"PASS_THROUGH"}

    def _hurry(self, context):
        """Makes the timer fire more often from now on."""
        context.window_manager.event_timer_remove(self._timer)
        self._timer = None
        self._timer = context.window_manager.event_timer_add(SLICE_S, window=context.window)

    def cancel(self, context):
        """Stops when Blender closes or loads another file."""
        with unharmed():
            self._job.cancel()
        self._end(context)

    def _remember(self, ob) -> None:
        self._name, self._number = (ob.name, identity.number(ob)) if ob is not None else ("", 0)

    def _here(self):
        """The character, also if it was renamed; raises `AnyfaceError("mesh")` if it is gone."""
        ob = identity.with_number(self._number, self._name) if self._name else None
        if self._name and ob is None:
            raise AnyfaceError("mesh", f"{self._name} is gone")
        return ob

    def _open_way_back(self) -> None:
        if self.goes_back:
            self._way_back = WayBack(self._here(), self.bl_label)

    def _close_way_back(self, worked) -> None:
        """Keeps the result, and deletes the files that it has replaced."""
        self._written = True
        if self._way_back is not None:
            self._way_back.close()
        bake.settle(worked)

    def _break(self, context, raised: BaseException, worked=None):
        """Handles any exception: ends the job, restores the scene, tells the artist."""
        error, way_back = plain(raised), self._way_back
        self._way_back = None
        with unharmed():
            if self._job is not None and not self._job.done:
                self._job.cancel()
        self._end(context)
        if self._written:
            # The result was written before the error: it stays, and the artist can undo it.
            with unharmed():
                self.report({"WARNING"}, readable(f"Anyface: written, but then: {error}"))
            return {"FINISHED"}
        with unharmed():
            bake.discard(worked)
        with unharmed():
            if way_back is not None:
                error = way_back.go(error, isinstance(raised, AnyfaceError))
        error, ob = _save_details(error), None
        with unharmed():
            ob = identity.with_number(self._number, self._name) if self._name else None
        try:
            return self.fail(error, ob)
        except BaseException as again:
            plain(again)
            return Acting.fail(self, error)

    def _end(self, context):
        """Ends the job, so that the next one may start; discards a result not yet written."""
        job, landing, timer, way_back = self._job, self._landing, self._timer, self._way_back
        self._landing = self._timer = None
        if job is not None:
            running.finish()
        with unharmed():
            if landing is not None:
                landing.close()
        with unharmed():
            if job is not None and not self._written:
                job.discard()
        with unharmed():
            if way_back is not None:
                way_back.close()
        with unharmed():
            if timer is not None:
                context.window_manager.event_timer_remove(timer)
        with unharmed():
            redraw(context)


def _save_details(error: AnyfaceError) -> AnyfaceError:
    with unharmed():
        return details.save(error)
    return error


def redraw(context) -> None:
    """Redraws every 3D view."""
    for area in _views(context):
        area.tag_redraw()


def redraw_sidebar(context) -> None:
    """Redraws only the sidebars, which show progress: the scene itself may take long to draw."""
    for area in _views(context):
        for region in area.regions:
            if region.type == "UI":
                region.tag_redraw()


def _views(context) -> list:
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    return [area for area in areas if area.type == "VIEW_3D"]
