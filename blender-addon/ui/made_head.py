"""Add > Mesh > Anyface Head."""

import bpy
from bpy.props import FloatProperty, FloatVectorProperty, IntProperty
from bpy.types import Operator

from ..core.errors import plain
from ..core.native_head import FARTHEST, Recipe
from ..scene.face import made_head, mesh
from . import running
from .add_head import AddHead, heads
from .operators import InThread
from .settings import from_object

SLIDERS = 22


class ANYFACE_OT_add_head(AddHead, Operator):
    """Add a head made from numbers, ready to speak: its landmarks are known"""

    bl_idname = "anyface.add_head"
    bl_label = "Add a Head"

    seed: IntProperty(name="Seed", description="Seed of the random head", default=0, min=0)
    other: IntProperty(name="Mix With", description="Seed of a second head", default=1, min=0)
    share: FloatProperty(
        name="Mix",
        description="Share of the second head; 0 leaves it out",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    changes: FloatVectorProperty(
        name="Shape",
        description="Values of the sliders: age, sex, weight and other traits, then the "
        "directions in which heads differ",
        size=SLIDERS,
        default=(0.0,) * SLIDERS,
        min=-FARTHEST,
        max=FARTHEST,
    )
    height: FloatProperty(
        name="Height",
        description="Height of head and neck; a human's is 0.35 m",
        default=2.0,
        min=0.001,
        soft_max=10.0,
        subtype="DISTANCE",
    )

    def execute(self, context):
        """Makes the head and adds it."""
        recipe = Recipe(self.seed, self.other, self.share, tuple(self.changes))
        try:
            head = heads().make(recipe)
            ob = self.add(context, made_head.mesh(head, self.height))
            made_head.keep_landmarks(ob, head)
        except BaseException as error:
            self.report({"ERROR"}, f"Anyface: {plain(error)}")
            return {"CANCELLED"}
        return {"FINISHED"}

    def draw(self, _context):
        """Draws the panel of the last operation."""
        layout = self.layout
        layout.use_property_split = True
        for name in ("seed", "other", "share"):
            layout.prop(self, name)
        column = layout.column(align=True)
        for number, name in enumerate(heads().directions()[:SLIDERS]):
            column.prop(self, "changes", index=number, text=name.capitalize())
        for name in ("height", "align", "location", "rotation"):
            layout.prop(self, name)


class ANYFACE_OT_head_like(InThread, Operator):
    """Make a closed head like this face, ready to speak; the mesh itself stays as it is"""

    bl_idname = "anyface.head_like"
    bl_label = "Head from This Mesh"

    cancelled = ""

    def read(self, context, ob):
        """Reads the mesh and its landmarks."""
        settings = from_object(ob)
        face = mesh.read_face(ob, settings.landmark_file)
        face.axes = settings.axes
        return made_head.Likeness(face, running.engine(settings.system))

    def finish(self, ob, likeness, worked):
        """Adds the head, as the active object."""
        head, far, height = worked
        new = made_head.beside(ob, head, height)
        for other in bpy.context.selected_objects:
            other.select_set(False)
        new.select_set(True)
        bpy.context.view_layer.objects.active = new
        return (
            f"{new.name}: {ob.name} lies {far:.1f} mm from it on average, on a head of human size"
        )
