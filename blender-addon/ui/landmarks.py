"""Find Face, and landmarks in the viewport: drawn, dragged over the surface, reset."""

import itertools

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty
from bpy.types import Operator, SpaceView3D
from bpy_extras import view3d_utils
from mathutils import Vector

from ..core.errors import AnyfaceError, plain
from ..core.job import Job, Progress
from ..scene import bake
from ..scene.face import landmarks
from ..scene.shape_keys import guard
from ..scene.way_back import unharmed
from . import character, running
from .operators import Acting, Alone, InThread, redraw
from .settings import from_object
from .target import target

# A landmark is taken from this far, in pixels.
_REACH_PX = 14.0
_handle = None


def search_of(ob, models: str | None = None) -> landmarks.Search:
    """A snapshot for finding the face of `ob` from nothing, by the folder `models` where one is
    given; raises `AnyfaceError`."""
    face, engine = _read(ob, models)
    face.landmarks = face.landmark_vertices = None
    return landmarks.Search(face, engine)


def _read(ob, models: str | None = None) -> tuple:
    """The face of `ob`, and the engine that looks for it."""
    guard.check_mesh(ob)
    settings = from_object(ob)
    return bake.read_face(ob, settings, editable=False), running.engine(settings.system, models)


def keep(ob, found, fixed=()) -> str:
    """Stores what was found on `ob` and lists its parts; returns it in words."""
    landmarks.store(ob, found, fixed)
    character.list_loose(ob, found)
    return landmarks.describe(landmarks.load(ob))


class ANYFACE_OT_find_face(InThread, Operator):
    """Find eyes, nose, mouth and jaw and keep their points; earlier ones are replaced"""

    bl_idname = "anyface.find_face"
    bl_label = "Find Face"

    cancelled = ""

    def read(self, context, ob):
        """The mesh."""
        return search_of(ob)

    def finish(self, ob, search, found):
        """Keeps the landmarks."""
        return keep(ob, found)


class ANYFACE_OT_reset_landmarks(Acting, Operator):
    """Forget the points of the face; the next take finds them"""

    bl_idname = "anyface.reset_landmarks"
    bl_label = "Reset Face Points"

    @classmethod
    def why_not(cls, context):
        ob = target(context)
        stored = ob is not None and landmarks.mesh.LANDMARKS_PROPERTY in ob
        return "" if stored else "No points are stored on the face"

    def act(self, ob):
        """Takes the property away."""
        try:
            landmarks.clear(ob)
        except (TypeError, RuntimeError) as error:
            raise AnyfaceError("mesh", str(error)) from error


class ANYFACE_OT_move_landmark(Alone, Operator):
    """Put one point elsewhere on the face; the others follow"""

    bl_idname = "anyface.move_landmark"
    bl_label = "Move Face Point"

    number: IntProperty(name="Point", min=0, max=67)
    place: FloatVectorProperty(name="Place", description="In the object's space", subtype="XYZ")

    def act(self, ob):
        """Puts the landmark on the nearest place of the surface and lets the others follow."""
        drag = landmarks.Drag(ob)
        drag.hold(self.number)
        drag.stored.positions[self.number] = drag.surface.nearest(self.place)
        found = drag.search(*_read(ob)).work(Progress())
        return keep(ob, found, drag.stored.fixed)


class ANYFACE_OT_edit_landmarks(Alone, Operator):
    """Drag points over the face with the left mouse button; Return or Esc ends"""

    bl_idname = "anyface.edit_landmarks"
    bl_label = "Edit Face Points"
    # Every drag is an undo step of its own; ending the operator is none.
    bl_options = {"REGISTER", "BLOCKING"}
    _job = _timer = None

    def execute(self, context):
        """Without a window there is nothing to drag with."""
        return self.fail("points are dragged in the 3D view; use Move Face Point in scripts")

    def invoke(self, context, event):
        """Shows the landmarks and waits for the pointer."""
        if bpy.app.background or context.region_data is None:
            return self.execute(context)
        self._name = target(context).name
        try:
            self._drag = landmarks.Drag(target(context))
            context.window_manager.anyface_show_landmarks = True
            context.workspace.status_text_set("Drag the points of the face; Return or Esc ends")
            self._timer = context.window_manager.event_timer_add(0.05, window=context.window)
            context.window_manager.modal_handler_add(self)
            return {"RUNNING_MODAL"}
        except BaseException as error:
            return self._break(context, error)

    def modal(self, context, event):
        """One drag is one undo step."""
        try:
            return self._modal(context, event)
        except BaseException as error:
            return self._break(context, error)

    def _break(self, context, raised: BaseException):
        """Ends the dragging whatever was raised, and tells the artist; points that were let go
        stay where they are."""
        self._end(context)
        return self.fail(plain(raised))

    def _modal(self, context, event):
        redraw(context)
        ob = bpy.data.objects.get(self._name)
        ends = event.type in {"ESC", "RET", "NUMPAD_ENTER"} and event.value == "PRESS"
        if ob is None or ends:
            return self._end(context)
        if self._job is not None:
            return self._follow(ob)
        view = _view_under(context, event)
        if self._drag.held is not None and event.type == "MOUSEMOVE":
            if view is not None:
                self._move(ob, view)
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS" and view is not None:
            return self._press(ob, view)
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self._drag.held is not None:
            return self._release(ob)
        return {"PASS_THROUGH"}

    def _press(self, ob, view):
        # Undo may have brought other landmarks since.
        try:
            self._drag = landmarks.Drag(ob, self._drag.surface)
        except AnyfaceError as error:
            return self.fail(error)
        region, data, at = view
        places = on_screen(region, data, ob, self._drag.stored.positions)
        taken = self._drag.hold_near(np.array(at), places, _REACH_PX)
        return {"RUNNING_MODAL"} if taken else {"PASS_THROUGH"}

    def _move(self, ob, view):
        region, data, at = view
        back = ob.matrix_world.inverted_safe()
        origin = view3d_utils.region_2d_to_origin_3d(region, data, at)
        direction = view3d_utils.region_2d_to_vector_3d(region, data, at)
        self._drag.move(back @ origin, back.to_3x3() @ direction)
        shown[ob.name] = self._drag.stored.positions

    def _release(self, ob):
        """The others follow in a thread."""
        try:
            search = self._drag.search(*_read(ob))
        except AnyfaceError as error:
            shown.clear()
            self.fail(error)
            return {"RUNNING_MODAL"}
        self._drag.held = None
        self._job = running.start(Job(search.work), ob.name)
        return {"RUNNING_MODAL"}

    def _follow(self, ob):
        if not self._job.done:
            return {"RUNNING_MODAL"}
        job, self._job = self._job, None
        running.finish()
        shown.clear()
        try:
            keep(ob, job.result(), self._drag.stored.fixed)
            bpy.ops.ed.undo_push(message="Move Landmark")
        except AnyfaceError as error:
            self.fail(error)
        return {"RUNNING_MODAL"}

    def _end(self, context):
        self.cancel(context)
        with unharmed():
            redraw(context)
        return {"FINISHED"}

    def cancel(self, context):
        """Blender closes or loads another file, or the artist ends it."""
        shown.clear()
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


# Positions `[68, 3]` by object name that are drawn instead of the stored ones, during a drag.
shown: dict[str, np.ndarray] = {}


def _view_under(context, event):
    """Region, its view and the pointer in it, or None where the pointer is in no 3D view."""
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        for region in area.regions:
            x, y = event.mouse_x - region.x, event.mouse_y - region.y
            if region.type == "WINDOW" and 0 <= x < region.width and 0 <= y < region.height:
                return region, area.spaces.active.region_3d, (x, y)
    return None


def on_screen(region, data, ob, positions: np.ndarray) -> np.ndarray:
    """Pixels `[68, 2]` of positions in object space; NaN for those behind the viewer."""
    pixels = np.full((len(positions), 2), np.nan)
    for number, point in enumerate(positions):
        at = view3d_utils.location_3d_to_region_2d(region, data, ob.matrix_world @ Vector(point))
        if at is not None:
            pixels[number] = at
    return pixels


def segments(positions: np.ndarray) -> list:
    """Ends of the lines between neighbouring landmarks, `[2 N]` points."""
    pairs = [(a, b) for chain in landmarks.CHAINS for a, b in itertools.pairwise(chain)]
    for loop in landmarks.LOOPS:
        pairs += [(n, n + 1) for n in loop[:-1]] + [(loop[-1], loop[0])]
    return [positions[n].tolist() for pair in pairs for n in pair]


def _draw() -> None:
    context = bpy.context
    ob = target(context) if context.window_manager.anyface_show_landmarks else None
    if ob is None or not ob.visible_get():
        return
    try:
        stored = landmarks.load(ob)
    except AnyfaceError:
        return
    if stored is not None:
        _paint(ob, shown.get(ob.name, stored.positions), stored)


def kinds(stored: landmarks.Stored) -> tuple[list[int], list[int], list[int]]:
    """Numbers of the landmarks that were found, that are doubtful and that were put by hand."""
    doubtful = {n for name in stored.doubtful for n in landmarks.REGIONS[name]} - stored.fixed
    found = set(range(landmarks.COUNT)) - stored.fixed - doubtful
    return sorted(found), sorted(doubtful), sorted(stored.fixed)


def _paint(ob, positions: np.ndarray, stored: landmarks.Stored) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    found, doubtful, held = (positions[numbers].tolist() for numbers in kinds(stored))
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    gpu.state.depth_test_set("NONE")
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(ob.matrix_world)
        layers = (
            ("LINES", segments(positions), (0.1, 0.8, 1.0, 0.5)),
            ("POINTS", found, (0.1, 0.9, 1.0, 1.0)),
            ("POINTS", doubtful, (1.0, 0.5, 0.0, 1.0)),
            ("POINTS", held, (0.3, 1.0, 0.3, 1.0)),
        )
        gpu.state.blend_set("ALPHA")
        gpu.state.point_size_set(7.0)
        for kind, points, colour in layers:
            if points:
                shader.uniform_float("color", colour)
                batch_for_shader(shader, kind, {"pos": points}).draw(shader)
    gpu.state.blend_set("NONE")


def register() -> None:
    """Adds the drawing and its switch."""
    global _handle
    bpy.types.WindowManager.anyface_show_landmarks = BoolProperty(
        name="Show Face Points", description="Draw the points of the face in the 3D view"
    )
    if not bpy.app.background:
        _handle = SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    """Takes them away."""
    global _handle
    if _handle is not None:
        SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    shown.clear()
    del bpy.types.WindowManager.anyface_show_landmarks
