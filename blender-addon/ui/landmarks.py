"""Find Face, and landmarks in the viewport: drawn, clicked, dragged over the surface, reset."""

import itertools

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty
from bpy.types import Operator, SpaceView3D
from bpy_extras import view3d_utils
from mathutils import Vector

from ..core.errors import AnyfaceError
from ..core.job import Progress
from ..scene import bake
from ..scene.face import landmarks
from ..scene.shape_keys import guard
from . import character, running
from .in_view import InView
from .operators import Acting, Alone, InThread
from .settings import from_object
from .target import target

# The pointer grabs a landmark within this distance, pixels.
_REACH_PX = 14.0
# The colour of points that the artist has placed.
_PLACED = (0.3, 1.0, 0.3, 1.0)
_handle = None


def search_of(ob, models: str | None = None) -> landmarks.Search:
    """A snapshot for finding the face of `ob` anew, ignoring stored landmarks.

    `models` is the folder of the models; None takes the one of the scene. Raises `AnyfaceError`.
    """
    face, engine = _read(ob, models)
    face.landmarks = face.landmark_vertices = None
    return landmarks.Search(face, engine)


def _read(ob, models: str | None = None) -> tuple:
    """The face of `ob`, and the engine that finds its landmarks."""
    guard.check_mesh(ob)
    settings = from_object(ob)
    return bake.read_face(ob, settings, editable=False), running.engine(settings.system, models)


def keep(ob, face_points, fixed=()) -> str:
    """Stores landmarks on `ob` and lists its connected parts; returns a description."""
    landmarks.store(ob, face_points, fixed)
    character.list_loose(ob, face_points)
    return landmarks.describe(landmarks.load(ob))


class ANYFACE_OT_find_face(InThread, Operator):
    """Find eyes, nose, mouth and jaw and keep their points; earlier ones are replaced"""

    bl_idname = "anyface.find_face"
    bl_label = "Find Face"

    cancelled = ""

    def read(self, context, ob):
        """Reads the mesh."""
        return search_of(ob)

    def finish(self, ob, search, face_points):
        """Stores the landmarks."""
        return keep(ob, face_points)


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
        """Removes the property."""
        try:
            landmarks.clear(ob)
        except (TypeError, RuntimeError) as error:
            raise AnyfaceError("mesh", str(error)) from error


class ANYFACE_OT_move_landmark(Alone, Operator):
    """Move one point to another place on the face; the others follow"""

    bl_idname = "anyface.move_landmark"
    bl_label = "Move Face Point"

    number: IntProperty(name="Point", min=0, max=67)
    place: FloatVectorProperty(
        name="Place", description="Position in the object's space", subtype="XYZ"
    )

    def act(self, ob):
        """Puts the landmark on the nearest point of the surface and lets the others follow."""
        drag = landmarks.Drag(ob)
        drag.hold(self.number)
        drag.stored.positions[self.number] = drag.surface.nearest(self.place)
        face_points = drag.search(*_read(ob)).work(Progress())
        return keep(ob, face_points, drag.stored.fixed)


class ANYFACE_OT_edit_landmarks(InView, Operator):
    """Drag points over the face with the left mouse button; Return or Esc ends"""

    bl_idname = "anyface.edit_landmarks"
    bl_label = "Edit Face Points"
    words = "Drag the points of the face; Return or Esc ends"

    def execute(self, context):
        """Fails: a script has no pointer to drag with."""
        return self.fail("points are dragged in the 3D view; use Move Face Point in scripts")

    def begin(self, ob):
        """Shows the landmarks."""
        self._drag = landmarks.Drag(ob)

    def follow(self, context, ob, event, view):
        """Drags landmarks; each drag is one undo step."""
        if self._drag.number is not None and event.type == "MOUSEMOVE":
            if view is not None:
                self._move(ob, view)
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS" and view is not None:
            return self._press(ob, view)
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self._drag.number is not None:
            return self._release(ob)
        return {"PASS_THROUGH"}

    def _press(self, ob, view):
        # An undo may have changed the stored landmarks since the last drag.
        try:
            self._drag = landmarks.Drag(ob, self._drag.surface)
        except AnyfaceError as error:
            return self.fail(error)
        region, data, at = view
        places = on_screen(region, data, ob, self._drag.stored.positions)
        is_hit = self._drag.hold_near(np.array(at), places, _REACH_PX)
        return {"RUNNING_MODAL"} if is_hit else {"PASS_THROUGH"}

    def _move(self, ob, view):
        self._drag.move(*ray(ob, view))
        shown[ob.name] = self._drag.stored.positions

    def _release(self, ob):
        """Lets the other landmarks follow, in a thread."""
        try:
            search = self._drag.search(*_read(ob))
        except AnyfaceError as error:
            self.clear()
            self.fail(error)
            return {"RUNNING_MODAL"}
        self._drag.number = None
        self.search(ob, search)
        return {"RUNNING_MODAL"}

    def finish(self, ob, job):
        """Stores the landmarks and goes on, so that the artist can drag more."""
        try:
            keep(ob, job.result(), self._drag.stored.fixed)
            bpy.ops.ed.undo_push(message="Move Landmark")
        except AnyfaceError as error:
            self.fail(error)
        return False

    def clear(self):
        """Draws the stored landmarks again."""
        shown.clear()


class ANYFACE_OT_place_points(InView, Operator):
    """Click five points on the eyes, nose and mouth if the face was not found"""

    bl_idname = "anyface.place_points"
    bl_label = "Place Points"

    places: FloatVectorProperty(
        name="Places",
        description="Five points in the object's space, in the order of the clicks",
        size=15,
        options={"SKIP_SAVE"},
    )

    def act(self, ob):
        """Finds the face from places that a script has set."""
        places = np.array(self.places).reshape(5, 3)
        if not np.ptp(places, axis=0).any():
            text = "places: expected five points of the face, in a window by clicks, got none"
            raise AnyfaceError("input", text)
        surface = landmarks.Surface(ob)
        return self._keep(
            ob, self._search(ob, [surface.nearest(p) for p in places]).work(Progress())
        )

    def begin(self, ob):
        """Starts without any clicks."""
        self._surface, self._places = landmarks.Surface(ob), []
        self.words = landmarks.ask_for_click(0)

    def follow(self, context, ob, event, view):
        """Places a point at a click; Backspace removes the last one."""
        if event.value == "PRESS" and event.type == "BACK_SPACE" and self._places:
            self._places.pop()
        elif event.value == "PRESS" and event.type == "LEFTMOUSE" and view is not None:
            place = self._surface.hit(*ray(ob, view))
            if place is None:
                return {"PASS_THROUGH"}
            self._places.append(place)
        else:
            return {"PASS_THROUGH"}
        placed[ob.name] = list(self._places)
        if len(self._places) == len(landmarks.CLICKS):
            self.search(ob, self._search(ob, self._places))
        else:
            context.workspace.status_text_set(landmarks.ask_for_click(len(self._places)))
        return {"RUNNING_MODAL"}

    def finish(self, ob, job):
        """Stores the face as one undo step."""
        self._keep(ob, job.result())
        bpy.ops.ed.undo_push(message="Place Points")
        return True

    def clear(self):
        """Removes the clicked points from the view."""
        placed.clear()

    def _search(self, ob, places):
        face, engine = _read(ob)
        face.landmarks = face.landmark_vertices = None
        numbers = [number for number, _ in landmarks.CLICKS]
        return landmarks.Search(face, engine, dict(zip(numbers, places, strict=True)))

    def _keep(self, ob, face_points):
        return keep(ob, face_points, {number for number, _ in landmarks.CLICKS})


# By object name: positions `[68, 3]` that are drawn during a drag instead of the stored ones.
shown: dict[str, np.ndarray] = {}
# The points clicked so far, by object name.
placed: dict[str, list] = {}


def ray(ob, view) -> tuple[Vector, Vector]:
    """Origin and direction of the ray under the pointer, in object space."""
    region, data, at = view
    back = ob.matrix_world.inverted_safe()
    origin = view3d_utils.region_2d_to_origin_3d(region, data, at)
    direction = view3d_utils.region_2d_to_vector_3d(region, data, at)
    return back @ origin, back.to_3x3() @ direction


def on_screen(region, data, ob, positions: np.ndarray) -> np.ndarray:
    """Pixels `[68, 2]` of positions in object space; NaN for points behind the viewer."""
    pixels = np.full((len(positions), 2), np.nan)
    for number, point in enumerate(positions):
        at = view3d_utils.location_3d_to_region_2d(region, data, ob.matrix_world @ Vector(point))
        if at is not None:
            pixels[number] = at
    return pixels


def segments(positions: np.ndarray) -> list:
    """The ends of the lines between neighbouring landmarks, `[2 N]` points."""
    pairs = [(a, b) for chain in landmarks.CHAINS for a, b in itertools.pairwise(chain)]
    for loop in landmarks.LOOPS:
        pairs += [(n, n + 1) for n in loop[:-1]] + [(loop[-1], loop[0])]
    return [positions[n].tolist() for pair in pairs for n in pair]


def _draw() -> None:
    context = bpy.context
    ob = target(context) if context.window_manager.anyface_show_landmarks else None
    if ob is None or not ob.visible_get():
        return
    if ob.name in placed:
        _paint_layers(ob, (("POINTS", [p.tolist() for p in placed[ob.name]], _PLACED),))
        return
    try:
        stored = landmarks.load(ob)
    except AnyfaceError:
        return
    if stored is not None:
        _paint(ob, shown.get(ob.name, stored.positions), stored)


def kinds(stored: landmarks.Stored) -> tuple[list[int], list[int], list[int]]:
    """Numbers of the sure landmarks, of the doubtful ones, and of those placed by the artist."""
    doubtful = {n for name in stored.doubtful for n in landmarks.REGIONS[name]} - stored.fixed
    sure = set(range(landmarks.COUNT)) - stored.fixed - doubtful
    return sorted(sure), sorted(doubtful), sorted(stored.fixed)


def _paint(ob, positions: np.ndarray, stored: landmarks.Stored) -> None:
    sure, doubtful, by_hand = (positions[numbers].tolist() for numbers in kinds(stored))
    layers = (
        ("LINES", segments(positions), (0.1, 0.8, 1.0, 0.5)),
        ("POINTS", sure, (0.1, 0.9, 1.0, 1.0)),
        ("POINTS", doubtful, (1.0, 0.5, 0.0, 1.0)),
        ("POINTS", by_hand, _PLACED),
    )
    _paint_layers(ob, layers)


def _paint_layers(ob, layers) -> None:
    """Draws layers, each given as kind (lines or points), places in object space, and colour."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.bind()
    gpu.state.depth_test_set("NONE")
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(ob.matrix_world)
        gpu.state.blend_set("ALPHA")
        gpu.state.point_size_set(7.0)
        for kind, points, colour in layers:
            if points:
                shader.uniform_float("color", colour)
                batch_for_shader(shader, kind, {"pos": points}).draw(shader)
    gpu.state.blend_set("NONE")


def register() -> None:
    """Adds the draw handler, and the property that turns drawing on."""
    global _handle
    bpy.types.WindowManager.anyface_show_landmarks = BoolProperty(
        name="Show Face Points", description="Draw the points of the face in the 3D view"
    )
    if not bpy.app.background:
        _handle = SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    """Removes both."""
    global _handle
    if _handle is not None:
        SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    shown.clear()
    placed.clear()
    del bpy.types.WindowManager.anyface_show_landmarks
